module top(a, b);
  (* src = "hdl/left.py:3" *)
  wire right_py_7_1 ;
  wire b_4__low_3_2 ;
  wire begin__next ;
  wire [3:0] b_4__low_ ;
  wire net_5 ;
  reg begin_ ;
  reg b_4__low;
  wire net_6 ;
  wire c_next;
  assign right_py_7_1  = a & (* src = "amaranth/right.py:7|y.py:8" *) begin__next ;
  assign b_4__low_3_2  = b_4__low_ [3];
  assign net_5  = 1'h0;
  always @(posedge clk)
    begin_  <= begin__next ;
    c <= net_6 ;
endmodule
