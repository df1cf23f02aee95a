"""`same_verilog`: renamed and reordered Verilog passes, any other change is found."""

import re

import pytest

from tb.helpers.same_verilog import hashes, main

SOURCE = """\
// A comment.
(* keep = 1 *)
module leaf(clk, a, b, y);
  input clk;
  input [3:0] a;
  input [3:0] b;
  output reg [3:0] y;
  reg [3:0] \\y$1 = 4'h3;
  wire more;
  assign more = a > b;
  always @(posedge clk)
    if (more) \\y$1 <= a - b;
    else \\y$1 <= 4'h7;
  always @* begin
    casez (more)
      1'h1: y = \\y$1 ;
      default: y = a;
    endcase
  end
endmodule
module top(clk, p, q, o);
  input clk;
  input [3:0] p;
  input [3:0] q;
  output [3:0] o;
  wire [3:0] middle;
  leaf first (.clk(clk), .a(p), .b(q), .y(middle));
  leaf second (
    .clk(clk),
    .a(middle),
    .b({ p[1:0], q[3:2] }),
    .y(o)
  );
endmodule
"""

SAME = {
    "names": [(r"\bmore\b", "larger"), (r"\ba\b", "minuend"), (r"\bleaf\b", "part")],
    "order of declarations": [(r"(  input \[3:0\] a;\n)(  input \[3:0\] b;\n)", r"\2\1")],
    "order of connections": [(r"\.clk\(clk\), \.a\(p\)", ".a(p), .clk(clk)")],
    "comments": [(r"A comment", "Another"), (r"keep = 1", "src = 2")],
}

OTHER = {
    "an operand": [(r"a - b", "b - a")],
    "a constant": [(r"4'h7", "4'h6")],
    "an initial value": [(r"4'h3", "4'h2")],
    "a width": [(r"reg \[3:0\]", "reg [4:0]")],
    "an operator": [(r"a > b", "a >= b")],
    "a connection": [(r"\.a\(p\), \.b\(q\)", ".a(q), .b(p)"), (r"p\[1:0\], q\[3:2\]", "q, p")],
    "bits of a signal": [(r"p\[1:0\]", "p[2:1]")],
    "a statement less": [(r"    else .*\n", "")],
    "an edge": [(r"posedge", "negedge")],
}


def changed(changes: list[tuple[str, str]]) -> str:
    text = SOURCE
    for pattern, new in changes:
        text, count = re.subn(pattern, new, text)
        assert count, pattern
    return text


@pytest.mark.parametrize("name", SAME)
def test_names_and_order_pass(name):
    assert sorted(hashes([SOURCE]).values()) == sorted(hashes([changed(SAME[name])]).values())


@pytest.mark.parametrize("name", OTHER)
def test_other_changes_are_found(name):
    assert sorted(hashes([SOURCE]).values()) != sorted(hashes([changed(OTHER[name])]).values())


def test_two_folders(tmp_path, capsys):
    for folder, text in (("old", SOURCE), ("new", changed(OTHER["a constant"]))):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "top.v").write_text(text)
    assert main([str(tmp_path / "old"), str(tmp_path / "old")]) == 0
    assert "2 and 2 modules: the same but for names" in capsys.readouterr().out
    assert main([str(tmp_path / "old"), str(tmp_path / "new")]) == 1
    assert capsys.readouterr().out.split("\n")[:4] == ["- leaf", "- top", "+ leaf", "+ top"]
