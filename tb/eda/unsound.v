module inner(input a, output b);
  assign b = ~a;
endmodule
module unsound(input [3:0] i, output reg latch, output loop, output reg twice, output none);
  wire there, nothing;
  always @* if (i[0]) latch = i[1];
  inner one(there, loop);
  inner two(loop, there);
  always @* twice = i[2];
  always @* twice = i[3];
  assign none = nothing & i[0];
endmodule
