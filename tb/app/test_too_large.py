"""Pictures larger than the machine allows: refused by every command that models the machine."""

import json

import pytest

from tb.helpers.command import check_refused, write_scene


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a scene and, in large.json, a camera of 1957×1091."""
    monkeypatch.chdir(tmp_path)
    write_scene(tmp_path)
    camera, *_ = json.loads((tmp_path / "cameras.json").read_text())
    (tmp_path / "large.json").write_text(json.dumps([camera | {"width": 1957, "height": 1091}]))
    (tmp_path / "wide.toml").write_text('name = "WIDE"\nwidth_max = 2048\nheight_max = 2048\n')
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    yield
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    "command",
    [
        "cycles scene.ply",
        "cycles scene.ply --quality compact",
        "render scene.ply -o a.png --engine golden",
        "render scene.ply -o a.png --engine rtl",
        "compare reference golden --scene scene.ply",
        "compare rtl reference --scene scene.ply",
        "power scene.ply",
        "error scene.ply --stage all",
    ],
)
@pytest.mark.parametrize(
    "view, size",
    [("--camera large.json", "1957x1091"), ("--size 4000x4000", "4000x4000"),
     ("--preset wide.toml --size 2048x2049", "2048x2049")],
)  # fmt: skip
def test_too_large(place, capsys, command, view, size):
    most = "preset WIDE renders up to 2048x2048" if "wide" in view else "DEFAULT renders up to 1920"
    check_refused(capsys, f"{command} {view}", f"^error: picture of {size}: .*{most}")


@pytest.mark.parametrize("command", ["scenes", "quality", "rule", "ablation", "sweep"])
def test_benchmarks(place, capsys, command):
    check_refused(
        capsys, f"bench {command} scene.ply --size 4000x4000 -o wk",
        "picture of 4000x4000: preset DEFAULT renders up to 1920x1080",
    )  # fmt: skip


def test_the_reference_has_no_largest(place, capsys):
    """The reference has no machine's limit: it takes any size that a camera may have."""
    check_refused(capsys, "compare reference none.png --scene scene.ply --size 2000x20", "none.png")
