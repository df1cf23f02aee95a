"""Splatcore, an open accelerator for 3D Gaussian Splatting: golden model, hardware and tools.

The rooms of the repository are its packages, by links in this folder: `splatcore.spec`, `model`,
`golden`, `hdl`, `sim`, `eda`, `study` and `app`.
The names in `__all__` are the surface for Python programs (docs/python.md): they stay. Each is
imported when it is first asked for, so that `import splatcore` itself takes no time.
"""

_FROM = {
    "open_scene": "app.python.scenes",
    "make_scene": "app.python.scenes",
    "open_cameras": "app.python.scenes",
    "look_at": "app.python.scenes",
    "Camera": "spec.camera",
    "preset": "app.python.scenes",
    "Config": "spec.config",
    "pack": "app.python.frames",
    "render_reference": "app.python.frames",
    "render_golden": "app.python.frames",
    "compare": "app.python.frames",
    "cycles": "app.python.frames",
    "write": "app.python.files",
    "export": "app.python.files",
    "InputError": "spec.error",
}

__all__ = list(_FROM)


def __getattr__(name: str):
    if name not in _FROM:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    from importlib import import_module

    found = getattr(import_module(f"{__name__}.{_FROM[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
