"""Outputs that overwrite an input, coincide, or cannot be written: refused by every command."""

from pathlib import Path

import pytest
import typer

from splatcore.app.cli.main import register
from splatcore.app.cli.options import NEW_FOLDER, Command, app, option, result, spread
from splatcore.app.cli.reference import all_commands
from splatcore.spec.error import InputError
from tb.helpers.command import load, run, write_scene


def test_every_command_is_checked():
    register()
    found = dict(all_commands(typer.main.get_command(app)))
    assert len(found) > 20
    assert all(isinstance(command, Command) for command in found.values())


@pytest.mark.parametrize("fault", [KeyboardInterrupt, InputError("no"), RuntimeError("no")])
def test_a_new_empty_folder_is_removed(tmp_path, monkeypatch, fault):
    """The checks and the clean-up apply to any command, even one defined here."""
    own = typer.Typer()

    @own.command(cls=Command)
    @spread
    def make(
        output: Path = NEW_FOLDER,
        keep: bool = option(False, None, "Leave a file."),
    ) -> dict:
        (output / "parts").mkdir(parents=True)
        if keep:
            (output / "kept").touch()
        raise fault

    monkeypatch.chdir(tmp_path)
    error = type(fault) if isinstance(fault, Exception) else fault
    with pytest.raises((error, SystemExit)):
        own(["-o", "new"])
    assert not Path("new").exists()
    with pytest.raises(InputError, match="the same file"):
        own(["-o", "new", "--json", "new"])
    with pytest.raises((error, SystemExit)):
        own(["-o", "new", "--keep"])
    assert Path("new/kept").exists() and not Path("new/parts").exists()
    Path("old").mkdir()
    with pytest.raises((error, SystemExit)):
        own(["-o", "old"])
    assert Path("old").exists()


def test_a_result_is_written_and_a_wrong_one_exits_with_1(tmp_path):
    """A parameter's text is read before the command runs."""
    own, file = typer.Typer(), tmp_path / "a.json"

    @own.command(cls=Command)
    @spread
    def judge(even: int = option("2", "N", "A number.", read=int)) -> dict:
        return result({"even": even}, even % 2)

    for words, status in (([], 0), (["--even", "3"], 1)):
        with pytest.raises(SystemExit) as stop:
            own([*words, "--json", str(file)])
        assert stop.value.code == status and load(file) == {"even": 2 + status}


def test_a_campaign_without_a_result_leaves_none(tmp_path, monkeypatch, capsys):
    """A scene cut off after its header: one line for it, one for the campaign, and no file."""
    monkeypatch.chdir(tmp_path)
    write_scene(tmp_path)
    Path("cut.ply").write_bytes(Path("scene.ply").read_bytes()[:5000])
    assert run("bench rule cut.ply -o wk --size 32x32") == 2
    printed = capsys.readouterr()
    why, end = printed.err.splitlines()
    assert not printed.out and "cut.ply" in why and end == "error: rule: all measurements failed"
    assert not Path("wk").exists()
