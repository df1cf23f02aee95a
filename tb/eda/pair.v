module pair(input clk, input rst, output one, output other);
  left_top left(.clk(clk), .rst(rst), .interrupt(one));
  right_top right(.clk(clk), .rst(rst), .interrupt(other));
endmodule
