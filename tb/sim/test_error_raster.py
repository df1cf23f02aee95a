"""The sweep of stage 3's formats."""

import pytest

from splatcore.sim.accuracy import raster as error_raster
from splatcore.sim.accuracy.raster import raster_errors, raster_table, write_raster_plot
from splatcore.sim.common.scenes import View


@pytest.mark.slow
def test_fewer_bits_cost_decibels_and_save_gates(monkeypatch, tmp_path):
    monkeypatch.setattr(error_raster, "SWEEP", {"sum_fraction": (10,)})
    found = raster_errors({"garden": View("garden", size="160x90")})
    full, cut = found["DEFAULT"], found["sum_fraction 10"]
    assert full["gates"] > cut["gates"] > 1000
    assert full["scenes"]["garden"]["psnr_db"] > cut["scenes"]["garden"]["psnr_db"] + 1
    assert cut["scenes"]["garden"]["max_error"] > full["scenes"]["garden"]["max_error"] > 0
    assert raster_table(found).row_count == 2
    write_raster_plot(tmp_path / "formats.png", found)
    assert (tmp_path / "formats.png").stat().st_size > 10_000
