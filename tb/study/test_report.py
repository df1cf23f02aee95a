"""`splatcore report`: a self-contained page whose tables have the numbers of its results."""

import csv
import os
import re
import shutil
import subprocess

import pytest

from splatcore.sim.common.plot import STYLE
from splatcore.sim.frame.picture import read_png
from splatcore.study.report.titles import titles
from tb.helpers.command import ROOT
from tb.helpers.report_page import Page, Report
from tb.helpers.report_samples import SIZE, VIEWS

BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture
def whole(samples) -> Report:
    """The report made from samples of all results."""
    return Report(samples / "measured", 0, "")


def test_the_page_is_self_contained(whole):
    page = Page(whole.text)
    assert list(page.sections) == [*titles(), "missing"]
    assert len(page.ids) == len(set(page.ids)), "an id twice"
    inside = {f"#{name}" for name in page.ids}
    assert all(link in inside or link.startswith("data:image/png;base64,") for link in page.links)
    used = set(re.findall(r"url\(([^)]*)\)", whole.text))
    assert used and used <= inside
    assert not re.search(r"https?:|<script|<link|@import|<iframe", whole.text)
    assert page.images and all(uri.startswith("data:image/png;base64,") for uri in page.images)
    assert "None: every section is complete." in page.sections["missing"]


def test_every_figure_names_its_command(whole):
    figures = Page(whole.text).figures
    items = [s[k] for s in whole.sections.values() for k in ("tables", "figures")]
    assert len(figures) == sum(map(len, items)) > 25
    for figure in figures:
        assert "figcaption" in figure.tags and figure.tags & {"table", "svg", "img"}
        assert figure.command.startswith(("make RESULTS=", "splatcore "))
    assert all(item["commands"] for found in items for item in found.values())
    place = whole.folder.parent / "results"
    assert f"make RESULTS={place} SIZE={SIZE} {place}/sweep/sweep.json" in whole.text


def test_tables_are_the_same_everywhere(whole):
    files = {path.stem: path for path in (whole.folder / "tables").iterdir()}
    page, count = whole.text, 0
    for section in whole.sections.values():
        for key, table in section["tables"].items():
            with files.pop(key).open(newline="") as file:
                head, *rows = csv.reader(file)
            assert head == table["columns"]
            texts = [
                ["" if value is None else str(value) for value in row] for row in table["rows"]
            ]
            assert rows == texts
            place = page[page.index(f'id="item-{key}"') :]
            assert place[: place.index("</table>")].count("<tr") == len(rows) + 1
            count += len(rows)
    assert not files and count > 60


def test_numbers(whole):
    """Cells of the tables equal values computed here from the samples."""
    frame = VIEWS["vase.ply", "0"]
    first = next(row for row in whole.table("scenes", "scenes") if row["scene"] == "vase.ply")
    assert first["frame, M cycles"] == frame / 1e6 and first["FPS, at 800 MHz"] == 160
    assert first["model, off by %"] == pytest.approx(-1) and first["traffic, MB"] == 4
    assert whole.table("scenes", "traffic")[0]["image, MB"] == 3
    budget = whole.table("budget", "budget")
    assert [(row["group"], row["part"]) for row in budget[:5]] == [
        ("packing", part) for part in ("shape", "degree 1", "degree 2", "degree 3",
                                       "sum of the parts")
    ]  # fmt: skip
    assert budget[0]["vase 0, dB"] == 60 and budget[0]["hall roof, dB"] == 62
    assert budget[3]["vase 0, dB"] is None and budget[3]["hall roof, dB"] == 62
    largest = whole.table("budget", "budget-largest")
    assert len(largest) == len(budget) - 3 and largest[0]["hall door"] == pytest.approx(2)
    assert whole.table("budget", "budget-wholes")[2]["PSNR, scene, dB"] == 48
    assert whole.table("paper", "memories")[0]["size, KB"] == 4
    operations = whole.table("paper", "operations")
    saved = [100 * (1 - 94 / 198), 100 * (1 - 104 / 140), 100 * (1 - 121 / 157)]
    assert [row["saved, % of operations"] for row in operations[1::2]] == pytest.approx(saved)
    assert operations[3]["cycles, per Gaussian"] == 4 and operations[3]["PEs"] == 14
    gains = whole.table("ablation", "ablation-gains")
    assert gains[0]["all together, ×"] == pytest.approx(129 / 20.4)
    assert gains[0]["+ guard band, ×"] is None
    assert gains[0]["+ zero skipping, ×"] == pytest.approx(97.7 / 46.4)
    assert gains[1]["all together, ×"] == pytest.approx(5)
    power = whole.table("power", "power")
    assert power[0]["estimate, mW"] == pytest.approx(21) and power[0]["the paper, mW"] == 2.14


def test_the_page_on_the_paper():
    """Arithmetic and verdicts in the tables of docs/paper.md are right."""
    text = (ROOT / "docs" / "paper.md").read_text().replace("×", "*").replace("−", "-")
    rows = re.findall(r"^\| .* \| `(.*)` \| ([\d.]+) .*\| ([\d.]+) .*\| (.*) \|$", text, re.M)
    assert len(rows) == 20
    verdicts = []
    for arithmetic, result, limit, verdict in rows:
        value, limit = eval(arithmetic), float(limit)
        assert f"{value:.{len(result.partition('.')[2])}f}" == result, arithmetic
        agrees, fits = abs(value / limit - 1) < 0.005, value <= limit
        assert verdict in (
            "agrees" if agrees else "**does not agree**", "fits" if fits else "**does not fit**"
        ), arithmetic  # fmt: skip
        verdicts.append(verdict)
    assert verdicts.count("**does not agree**") == 1 and verdicts.count("**does not fit**") == 5


def test_text_is_escaped(whole):
    assert "thin &amp; &lt;long&gt;" in whole.text


def test_a_picture_is_shrunk(whole):
    uri = Page(whole.text).images[0]
    assert 1000 < len(uri) * 3 / 4 <= 1_000_100


def test_plots_can_be_read_in_print():
    sizes = [value for name, value in STYLE.items() if name.endswith(("size", "labelsize"))]
    assert min(size for size in sizes if size > 6) >= 8 and STYLE["lines.markersize"] < 6


@pytest.mark.slow
def test_in_a_browser(whole):
    """If a browser is installed it draws the page, and nothing is wider than the window."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        return  # the other tests parse the page
    picture = whole.folder / "page.png"
    subprocess.run(
        [browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
         "--host-resolver-rules=MAP * ~NOTFOUND", "--window-size=1280,4000",
         f"--screenshot={picture}", (whole.folder / "report.html").as_uri()],
        check=True, capture_output=True, env=os.environ | {"HOME": str(whole.folder)},
    )  # fmt: skip
    pixels = read_png(picture)
    assert pixels.std() > 20 and (pixels[:, 1240:] == 255).all() and (pixels[0] == 255).all()


def test_templates_are_in_the_package():
    """pyproject.toml lists the page's sources; without it an installed package lacks them."""
    text = (ROOT / "pyproject.toml").read_text()
    assert "*.jinja" in text and "*.css" in text and "jinja2" in text
