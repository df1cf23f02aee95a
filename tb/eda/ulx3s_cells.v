// Ports of the ECP5's cells that LiteX instantiates for a ULX3S. Those in yosys are no help: neither
// Icarus nor slang reads them.
module EHXPLLL (
  input CLKI, RST, STDBY,
  output CLKOP, CLKOS, CLKOS2, LOCK
);
  parameter CLKFB_DIV = 1, CLKI_DIV = 1, FEEDBK_PATH = "CLKOP";
  parameter CLKOP_CPHASE = 0, CLKOP_DIV = 1, CLKOP_ENABLE = "ENABLED", CLKOP_FPHASE = 0;
  parameter CLKOS_CPHASE = 0, CLKOS_DIV = 1, CLKOS_ENABLE = "ENABLED", CLKOS_FPHASE = 0;
  parameter CLKOS2_CPHASE = 0, CLKOS2_DIV = 1, CLKOS2_ENABLE = "ENABLED", CLKOS2_FPHASE = 0;
endmodule

module FD1S3BX (input CK, D, PD, output Q);
endmodule

module ODDRX1F (input D0, D1, RST, SCLK, output Q);
endmodule

module OFS1P3BX (input D, PD, SCLK, SP, output Q);
endmodule

module IFS1P3BX (input D, PD, SCLK, SP, output Q);
endmodule

module TRELLIS_IO (inout B, input I, T, output O);
  parameter DIR = "BIDIR";
endmodule
