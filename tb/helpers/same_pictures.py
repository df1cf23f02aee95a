"""Compare the packed models and pictures of two checkouts: of the garden and of all scenes found.

    python -m tb.helpers.same_pictures OLD NEW [SCENE…]

OLD and NEW are folders in which `make install` has run. Each scene is packed by both, and its first
view rendered by the golden model for two machines. Prints one line per file that differs, and the
count of those compared; exits with status 1 if any differs.
"""

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from splatcore.sim.frame.source import scene_files, scene_folder

SIZE = "320x180"
MACHINES = ("DEFAULT", "PAPER")
QUALITIES = ("compact", "faithful")


def files(checkout: Path, scene: str, folder: Path) -> dict[str, bytes]:
    """Return the files that a checkout makes of a scene: packed models and pictures."""
    folder.mkdir(parents=True)
    command = checkout.absolute() / ".venv" / "bin" / "splatcore"
    for machine in MACHINES:
        for quality in QUALITIES if machine == "DEFAULT" else QUALITIES[:1]:
            model = folder / f"{machine}-{quality}.splatcore"
            shared = ["--preset", machine]
            run(command, "pack", scene, "-o", model, "--quality", quality, *shared)
            picture = model.with_suffix(".png")
            view = ["--size", SIZE, "--engine", "golden", "--no-compare"]
            run(command, "render", model, "-o", picture, *view, *shared)
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def run(*words: str | Path):
    """Run a command; raise SystemExit with its last line if it fails."""
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, words))}: {done.stderr.strip().splitlines()[-1]}")


def main(old: str, new: str, *scenes: str) -> int:
    """Compare the files of each scene; return the exit status."""
    found = scenes or ("garden", *(map(str, scene_files()) if scene_folder().is_dir() else ()))
    compared, different = 0, 0
    for scene in found:
        with TemporaryDirectory() as folder:
            one, other = (
                files(Path(checkout), os.path.abspath(scene) if os.path.exists(scene) else scene,
                      Path(folder) / side)
                for side, checkout in (("old", old), ("new", new))
            )  # fmt: skip
        for name in sorted({*one, *other}):
            compared += 1
            if one.get(name) != other.get(name):
                different += 1
                print(f"{scene}: {name} differs", flush=True)
    print(f"{compared} files compared, {different} different")
    return bool(different)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
