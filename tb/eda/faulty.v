module faulty(input clk, input [3:0] i, output reg [3:0] o, output p);
  always @* if (i[0]) o = i;
endmodule
