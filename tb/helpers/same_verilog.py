"""Compare two folders of generated Verilog: `python -m tb.helpers.same_verilog OLD NEW`.

Names, comments, attributes and the order of declarations may differ; nothing else may. yosys reads
the files. Modules, leaves first, are compared by colour refinement: a bit's colour is a hash of the
cells at which it ends and of its places there, refined until no two bits part any more.
"""

import json
import sys
from collections import Counter, defaultdict
from hashlib import blake2b
from pathlib import Path

from splatcore.eda.gates.synth import yosys

READ = """
read_verilog -overwrite {files}
proc
memory_collect
write_json netlist.json
"""

NAMES = ("MEMID",)  # parameters of cells that are names


def digest(*parts: object) -> str:
    return blake2b(repr(parts).encode(), digest_size=8).hexdigest()


def refined(module: dict, known: dict[str, tuple[str, dict[str, str]]]) -> tuple[str, dict]:
    """A module's hash, and the colour of each of its ports. known: those of the modules in it."""
    cells = []
    for cell in module["cells"].values():
        kind, ports = known.get(cell["type"], (cell["type"], {}))
        values = {k: v for k, v in cell["parameters"].items() if k not in NAMES}
        nets = [(ports.get(name, name), bits) for name, bits in cell["connections"].items()]
        cells.append((digest(kind, sorted(values.items())), sorted(nets)))
    colours: dict = defaultdict(str)  # of bits that are no constants
    for port in module["ports"].values():
        for place, bit in enumerate(port["bits"]):
            if isinstance(bit, int):
                colours[bit] = digest(colours[bit], port["direction"], len(port["bits"]), place)
    for net in module["netnames"].values():
        if init := net["attributes"].get("init"):
            for bit, value in zip(reversed(net["bits"]), init, strict=True):
                colours[bit] = digest(colours[bit], value)
    classes = 0
    while True:
        places, hashes = defaultdict(list), Counter()
        for kind, nets in cells:
            parts = [(name, [colours.get(bit, bit) for bit in bits]) for name, bits in nets]
            whole = digest(kind, parts)
            hashes[whole] += 1
            for name, bits in nets:
                for place, bit in enumerate(bits):
                    if isinstance(bit, int):
                        places[bit].append((whole, name, place))
        colours |= {bit: digest(colours[bit], sorted(found)) for bit, found in places.items()}
        if len(set(colours.values())) == classes:
            break
        classes = len(set(colours.values()))
    ports = {
        name: digest(port["direction"], [colours.get(bit, bit) for bit in port["bits"]])
        for name, port in module["ports"].items()
    }
    return digest(sorted(hashes.items()), sorted(ports.values())), ports


def hashes(texts: list[str]) -> dict[str, str]:
    """The hash of each module of some files, leaves first."""
    files = {f"{number}.v": text for number, text in enumerate(texts)}
    netlist = yosys(READ.format(files=" ".join(files)), files)["netlist.json"]
    left, known = json.loads(netlist)["modules"], {}
    while left:
        kinds = {name: {c["type"] for c in body["cells"].values()} for name, body in left.items()}
        for name in [name for name in left if not kinds[name] & left.keys()]:
            known[name] = refined(left.pop(name), known)
    return {name: hashed for name, (hashed, _) in known.items()}


def of_folder(folder: Path) -> dict[str, str]:
    """The hash of each module of a folder's files; of testbenches, that of the text."""
    texts = {path: path.read_text() for path in sorted(folder.rglob("*.v"))}
    benches = {path for path in texts if path.stem.endswith("_testbench")}
    found = hashes([text for path, text in texts.items() if path not in benches])
    return found | {path.stem: digest(texts[path]) for path in benches}


def main(words: list[str]) -> int:
    """Print the modules without an equal on the other side, with all above them; return 1 if there
    are any."""
    old, new = (of_folder(Path(folder)) for folder in words)
    counts, differ = (Counter(old.values()), Counter(new.values())), False
    for mark, found, extra in (
        ("-", old, counts[0] - counts[1]),
        ("+", new, counts[1] - counts[0]),
    ):
        for name, hashed in found.items():
            if extra[hashed]:
                print(mark, name)
                differ = True
    equal = "they differ" if differ else "the same but for names"
    print(f"{len(old)} and {len(new)} modules: {equal}")
    return differ


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
