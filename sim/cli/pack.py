"""The command `pack`: a scene as the model that the machine reads."""

from splatcore.model.pack.pack import STEPS, pack
from splatcore.sim.cli import options
from splatcore.sim.common import describe
from splatcore.sim.common.metric import difference
from splatcore.sim.common.output import check_writable, console, progress_bar, write, write_json
from splatcore.sim.common.source import open_camera, open_source
from splatcore.sim.machine.engines import reference
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

ShDegreeOption = options.option(int | None, None, "Keep harmonics up to this degree.", min=0, max=1)


@options.app.command("pack")
def pack_command(
    scene: options.SceneArgument,
    output: options.ModelOption,
    sh_degree: ShDegreeOption = None,
    preset: options.PresetOption = "DEFAULT",
    camera: options.CameraOption = None,
    size: options.SizeOption = None,
    json: options.JsonOption = None,
):
    """Pack a scene into the model that the machine reads, and say what that loses.

    The loss is the reference renderer's picture of the packed model against its picture of the
    scene, from one view: with the scene's harmonics cut to the packed degree, and with all.
    """
    check_writable(output, json)
    config = find_preset(preset)
    with progress_bar(f"reading {scene}"):
        source = open_source(scene)
        if source.scene is None:
            raise InputError(f"{scene}: is a packed model already, not a scene")
        original = source.scene
        view = open_camera(camera, size, source)
    with progress_bar("packing", len(STEPS)) as advance:

        def tell(step: str):
            advance(STEPS.index(step), len(STEPS), f"packing: {step}")

        model, report = pack(original, config, sh_degree, tell)
    rendered = {
        "packed model": model.gaussians(),
        "scene, same degree": original.with_sh_degree(report.sh_degree).gaussians(),
        "scene": source.gaussians,
    }
    packed, cut, whole = (
        reference(gaussians, view, label=label).pixels for label, gaussians in rendered.items()
    )
    facts = report.as_dict() | {"preset": config.name} | vars(difference(packed, cut))
    facts["psnr_db_all_harmonics"] = difference(packed, whole).psnr_db
    write(output, model.image.tobytes())
    console.print(describe.table({"model": str(output)} | facts))
    write_json(json, facts)
