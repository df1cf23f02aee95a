"""The command `cache`: compiled machines and synthesis results that are kept."""

from splatcore.app.cli.options import JsonOption, app, option
from splatcore.sim.common import cache
from splatcore.sim.common.output import console, write_json
from splatcore.sim.common.table import new_table, print_whole

EmptyOption = option(bool, None, "Delete everything in the cache.", "--empty")


@app.command("cache")
def cache_command(empty: EmptyOption = False, json: JsonOption = None):
    """Show or clear the cache of compiled machines and synthesis results.

    Cleared entries are rebuilt on demand, which takes minutes per machine. The environment variable
    SPLATCORE_CACHE sets another folder.
    """
    root = cache.cache_root()
    sizes = {kind: sum(map(cache.size_of, paths)) for kind, paths in cache.kept().items()}
    counts = {
        kind: sum(path.suffix != ".lock" for path in paths) for kind, paths in cache.kept().items()
    }
    table = new_table("kind", ("entries", "MB"))
    for kind, size in sizes.items():
        table.add_row(kind, f"{counts[kind]:,}", f"{size / 1e6:,.1f}")
    table.add_row("all", f"{sum(counts.values()):,}", f"{sum(sizes.values()) / 1e6:,.1f}")
    print_whole(table)
    if empty:
        cache.empty()
    console.print(f"{root}{': emptied' if empty else ''}", soft_wrap=True, markup=False)
    write_json(json, {"folder": str(root), "bytes": sizes, "emptied": empty})
