"""Count the habits of language that plain English leaves, by room: `python -m tb.helpers.habits`.

Prose is docstrings, comments and texts of two words or more in Python files, and Markdown outside
code blocks. The patterns count; reading decides: some hits of H3, H4, H9, H10 and H17 are right.
"""

import ast
import io
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tb.helpers.command import ROOT

ROOMS = (
    *("README.md", "CONTRIBUTING.md", "docs", "spec", "model", "golden", "hdl"),
    *("sim", "eda", "study", "app", "tb"),
)

UNITS = (
    "bytes?|bits?|cycles?|seconds?|frames?|pixels?|items?|words?|beats?|lines?|rows?|gates?|steps?"
    "|splats?|entries|entry|colou?rs?|pairs?|keys?|KB|MB|ms|points?|lanes?|floats?"
)
OF = (
    "Gaussian|splat|pixel|pair|cycle|second|frame|tile|group|list|entry|chunk|lane|point|item|word"
    "|beat|row|camera|view|scene|channel|block|key|step|side|picture|axis|stage|machine|line|minute"
)

HABITS = {
    "H1 told": r"\b(told|tells?|telling)\b",
    "H2 docstring: What …": r"\A\s*(What|How|Whatever|Whoever|Where|Who)\b(?!.*\?)",
    "H3 what is": r"\b[Ww]hat\b",
    "H4 those that": r"\b([Tt]hose|[Tt]hat|[Tt]he ones?) (that|of|which|whose|in|on|with)\b",
    "H5 so many": r"\bso (many|much|fast|few|long as|near|far)\b",
    "H6 is there": r"\b(is|are|was|were|be|been) there\b|\bthere are known\b",
    "H7 anew": r"\banew\b",
    "H8 at hand": r"\b(at hand|at work|under way|on (its|their) way)\b",
    "H9 lies": r"\b(lies|lie|lay|lying)\b",
    "H10 beside": r"\b[Bb]esides?\b",
    "H11 where there is": r"\bwhere (there|it|they|one|none|nothing|no|that)\b",
    "H12 nobody, who": r"\b([Nn]obody|[Ss]omebody|[Ww]hoever|[Ww]homever|who|whom)\b",
    "H13 one's": r"\b[Oo]ne's\b",
    "H14 but for": r"\b(but for|all but)\b",
    "H15 as X has it": r"\bas ([\w.']+ ){1,4}(has|have|had) (it|them)\b",
    "H16 given up": r"\bg[ia]ven? (out|up|away)\b|\bgives? (out|up|away)\b|\bgiving (out|up)\b",
    "H17 the least": r"\bthe (least|most)\b",
    "H18 in words": r"\bin words\b|\ba bit( for|:| of) ",
    "H19 X a Y": rf"(?<!per )\b({UNITS}) an? ({OF})s?\b",
    "H20 parameters in a row": r"(?m)^ *\w+(, \w+)*: [^\n]*[.;] \w+(, \w+)*: ",
    "H21 as before": r"\b(as before|of before|by hand|was tried|were tried|(is|are) not built)\b",
}

REFUSED = {
    "told": r"\btold\b",
    "anew": r"\banew\b",
    "one's own": r"\b[Oo]ne's own\b",
    "docstring that opens with What": r"\A\s*What\b(?!.*\?)",
    "X a Y without per": HABITS["H19 X a Y"],
}
"""Habits that no prose of the repository may have; `tb/test_house.py` refuses them."""


def prose(path: Path) -> Iterator[tuple[int, str, bool]]:
    """Pieces of a file's prose: line, text, and whether it is a docstring."""
    text = path.read_text()
    if path.suffix != ".py":
        blanked = re.sub(r"(?ms)^```.*?^```", lambda found: "\n" * found[0].count("\n"), text)
        yield from ((number, line, False) for number, line in enumerate(blanked.splitlines(), 1))
        return
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    tree, heads, parts = ast.parse(text), set(), set()
    for node in ast.walk(tree):
        if isinstance(node, documented) and ast.get_docstring(node):
            heads.add(id(node.body[0].value))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            heads.add(id(node.value))  # a docstring of a constant or field, too
        if isinstance(node, ast.JoinedStr):
            parts |= {id(each) for each in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts:
            if id(node) in heads or " " in node.value.strip():
                yield node.lineno, node.value, id(node) in heads
        elif isinstance(node, ast.JoinedStr):
            values = (each.value if isinstance(each, ast.Constant) else "…" for each in node.values)
            yield node.lineno, "".join(values), False
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string.lstrip("#:! "), False


def found(path: Path, patterns: dict[str, str]) -> Iterator[tuple[str, int, str]]:
    """Hits in a file: name of the pattern, line, the text around it."""
    for line, text, docstring in prose(path):
        for name, pattern in patterns.items():
            if "docstring" in name and not docstring:
                continue
            for hit in re.finditer(pattern, text):
                around = text[max(0, hit.start() - 30) : hit.end() + 30].replace("\n", " ")
                yield name, line + text[: hit.start()].count("\n"), around


def files(room: str, root: Path = ROOT) -> list[Path]:
    """Python and Markdown files of a room, or the page itself; without generated registers."""
    top = root / room
    paths = [top] if top.is_file() else [*top.rglob("*.py"), *top.rglob("*.md")]
    return sorted(
        path for path in paths if path.name != "registers.md" and "notes" not in path.parts
    )


def main(words: list[str]):
    """Print counts by habit and room; `ROOM … [HABIT]` lists the hits; `--root DIR`: in DIR."""
    root = Path(words.pop(words.index("--root") + 1)) if "--root" in words else ROOT
    words = [word for word in words if word != "--root"]
    if words:
        name = next((each for each in HABITS if each.split()[0] == words[-1]), None)
        patterns = {name: HABITS[name]} if name else HABITS
        for room in words[: -1 if name else None]:
            for path in files(room, root):
                for habit, line, around in found(path, patterns):
                    print(f"{path.relative_to(root)}:{line}: {habit.split()[0]}: …{around}…")
        return
    counts = {
        room: Counter(habit for path in files(room, root) for habit, _, _ in found(path, HABITS))
        for room in ROOMS
    }
    print(f"{'':26}" + "".join(f"{room.split('.')[0][:8]:>9}" for room in ROOMS) + f"{'all':>9}")
    for habit in HABITS:
        row = [counts[room][habit] for room in ROOMS]
        print(f"{habit:26}" + "".join(f"{each:9}" for each in (*row, sum(row))))


if __name__ == "__main__":
    main(sys.argv[1:])
