"""Compare two folders of generated Verilog: `python -m tb.helpers.same_verilog OLD NEW`.

Names, comments, attributes and the order of declarations may differ; nothing else may. Modules,
leaves first, are compared by colour refinement: an identifier's colour is a hash of the statements
that it stands in and of its places in them, refined until no two identifiers part any more.
"""

import re
import sys
from collections import Counter, defaultdict
from hashlib import blake2b
from pathlib import Path

TOKEN = re.compile(
    r"//[^\n]*|/\*.*?\*/|\(\*(?!\)).*?\*\)"  # left out
    r"|(\\\S+ |[A-Za-z_][\w$]*|\$\w+|\d*'s?[bodh][\w?]+|\d+|\"[^\"]*\""
    r"|<=|>=|[=!]==?|&&|\|\||<<<?|>>>?|\S)",
    re.S,
)

KEYWORDS = set(
    "module endmodule input output inout wire reg assign always begin end if else case casez"
    " endcase default posedge negedge or initial parameter localparam signed integer for function"
    " endfunction generate endgenerate".split()
)

OPENS, CLOSES = {"begin", "case", "casez", "("}, {"end", "endcase", ")"}


def tokens(text: str) -> list[str]:
    """Tokens of Verilog, without comments and attributes; a name without the mark of an escape."""
    return [found[1].removeprefix("\\").strip() for found in TOKEN.finditer(text) if found[1]]


def is_name(token: str) -> bool:
    return bool(re.match(r"[A-Za-z_\\]", token)) and token not in KEYWORDS


def statements(words: list[str]) -> list[list[str]]:
    """A module's tokens, from after its header's semicolon, as statements."""
    found, current, depth = [], [], 0
    for number, word in enumerate(words):
        current.append(word)
        depth += (word in OPENS) - (word in CLOSES)
        block = word in ("end", "endcase") and words[number + 1 : number + 2] != ["else"]
        if depth == 0 and (word == ";" or block):
            found.append(current)
            current = []
    return found + [current] * bool(current)


def modules(text: str) -> dict[str, list[list[str]]]:
    """Statements of each module; ports are declared in the statements, too."""
    found, words = {}, tokens(text)
    starts = [number for number, word in enumerate(words) if word == "module"]
    for start in starts:
        end = words.index("endmodule", start)
        first = words.index(";", start) + 1
        found[words[start + 1]] = statements(words[first:end])
    return found


def digest(*parts: object) -> str:
    return blake2b(repr(parts).encode(), digest_size=8).hexdigest()


def pieces(statement: list[str], known: dict[str, tuple[str, dict[str, str]]]):
    """A statement in the pieces whose order matters: an instance's connections have none.

    known: of each module its hash and the colours of its ports. Names of modules and of their
    ports, which belong to other modules, are replaced by these.
    """
    if statement[0] not in known:
        return [statement]
    hashed, ports = known[statement[0]]
    found, depth, current = [[hashed, *statement[1:2]]], 0, []
    for word in statement[2:]:
        depth += (word == "(") - (word == ")")
        if (word in (",", ";") and depth <= 1) or (word == "(" and depth == 1):
            found.append(current)
            current = []
        else:
            current.append(word)
    return [
        ["." + ports.get(piece[1], "?"), *piece[2:]] if piece[0] == "." else piece
        for piece in found
        if piece
    ]


def refined(body: list[list[str]], known: dict) -> tuple[str, dict[str, str]]:
    """A module's hash, and the colour of each of its names."""
    split = [pieces(statement, known) for statement in body]
    names = {word for each in split for piece in each for word in piece if is_name(word)}
    colours, classes = dict.fromkeys(names, ""), 0
    while True:
        places, hashes = defaultdict(list), Counter()
        for each in split:
            parts = [digest([colours.get(word, word) for word in piece]) for piece in each]
            whole = digest(sorted(parts))
            hashes[whole] += 1
            for part, piece in zip(parts, each, strict=True):
                for place, word in enumerate(piece):
                    if word in names:
                        places[word].append((whole, part, place))
        colours = {name: digest(colours[name], sorted(places[name])) for name in names}
        if len(set(colours.values())) == classes:
            return digest(sorted(hashes.items())), colours
        classes = len(set(colours.values()))


def hashes(texts: list[str]) -> dict[str, str]:
    """The hash of each module of some files, leaves first."""
    left, known = {}, {}
    for text in texts:
        left |= modules(text)
    while left:
        ready = [
            name
            for name, body in left.items()
            if not any(statement[0] in left for statement in body if statement[0] != name)
        ]
        for name in ready:
            known[name] = refined(left.pop(name), known)
    return {name: hashed for name, (hashed, _) in known.items()}


def differing(old: dict[str, str], new: dict[str, str]) -> tuple[list[str], list[str]]:
    """Return the modules of each side without an equal on the other; a module above one is among
    them."""
    extra, missing = Counter(new.values()) - Counter(old.values()), Counter(old.values())
    missing -= Counter(new.values())
    return (
        [name for name, hashed in old.items() if missing[hashed]],
        [name for name, hashed in new.items() if extra[hashed]],
    )


def main(words: list[str]) -> int:
    """Print the modules that differ, and all modules above them; return 1 if there are any."""
    old, new = (
        hashes([path.read_text() for path in sorted(Path(folder).rglob("*.v"))]) for folder in words
    )
    gone, come = differing(old, new)
    for mark, names in (("-", gone), ("+", come)):
        for name in names:
            print(mark, name)
    equal = "the same but for names" if not (gone or come) else "they differ"
    print(f"{len(old)} and {len(new)} modules: {equal}")
    return bool(gone or come)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
