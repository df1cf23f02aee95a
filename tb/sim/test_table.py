"""Tables on the terminal: values of rows, units, missing values, sums below a line."""

from dataclasses import dataclass

from splatcore.sim.common.table import Column, Table

COLUMNS = [Column("part"), Column("size", "KB", 1, get="bytes", per=1000, none="none")]
COLUMNS += [Column("ratio", digits=2, get=lambda row: 3), Column("db", digits=1, get="loss.db")]


@dataclass
class Part:
    part: str
    bytes: int


def test_rows_are_dicts_or_objects(capsys):
    rows = [Part("a", 123456), {"part": "b [c]", "bytes": None, "loss": {"db": -1.25}}]
    table = Table.of("parts", "title", COLUMNS, rows, frozenset([1]))
    assert table.rows == [["a", 123.456, 3, None], ["b [c]", None, 3, -1.25]]
    table.print()
    title, _, head, rule, first, line, last, *_ = capsys.readouterr().out.splitlines()
    assert title.strip() == "title" and head.split() == ["part", "size,", "KB", "ratio", "db"]
    assert first.split() == ["a", "123.5", "3.00", "–"]
    assert last.split() == ["b", "[c]", "none", "3.00", "−1.2"]
    assert set(rule.strip()) == {"─"} and not line.strip()


def test_wide_tables_are_whole_and_headings_may_lack(capsys):
    Table("facts", "", [Column(""), Column("")], [["name", "x" * 300]]).print()
    assert capsys.readouterr().out.split() == ["name", "x" * 300]
