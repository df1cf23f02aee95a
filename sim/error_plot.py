"""Draws what `sim.error` measured: error by field and picture quality against width."""

import io
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sim.output import write


def write_error_plot(path: str | Path, results: dict[str, dict], title: str):
    """RMS error of each field (left, logarithmic) and PSNR (right) for each width."""
    figure = Figure((11, 4.8), 100)
    FigureCanvasAgg(figure)
    fields, quality = figure.subplots(1, 2, width_ratios=(3, 2))
    names = list(next(iter(results.values()))["fields"])
    for width, result in results.items():
        rms = [max(result["fields"][name]["rms"], 1e-9) for name in names]
        fields.plot(names, rms, marker="o", label=f"{width} bits")
    fields.set_yscale("log")
    fields.set_ylabel("RMS error (pixels for u, v; else relative)")
    fields.tick_params(axis="x", rotation=40)
    fields.grid(alpha=0.3)
    fields.legend(title="exponent/fraction")
    quality.bar(list(results), [result["psnr_db"] or 0 for result in results.values()])
    for place, result in enumerate(results.values()):
        if result["psnr_db"]:
            quality.text(place, result["psnr_db"], f"{result['psnr_db']:.1f}", ha="center")
    quality.set_ylabel("PSNR against the reference, dB")
    quality.set_xlabel("exponent/fraction bits of stages 0 and 1")
    figure.suptitle(title, fontsize=10)
    figure.tight_layout()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    write(path, buffer.getvalue())
