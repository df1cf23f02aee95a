module top(a, b);
  (* src = "/home/x/hdl/left.py:3" *)
  wire \$1 ;
  wire \$2 ;
  wire \$3 ;
  wire [3:0] \b$4.low ;
  wire \$5 ;
  reg \begin ;
  reg b_4__low;
  wire \$6 ;
  wire c_next;
  assign \$1  = a & (* src = "/home/x/lib/site-packages/amaranth/right.py:7|/x/y.py:8" *) \$3 ;
  assign \$2  = \b$4.low [3];
  assign \$5  = 1'h0;
  always @(posedge clk)
    \begin  <= \$3 ;
    c <= \$6 ;
endmodule
