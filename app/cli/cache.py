"""The command `cache`: compiled machines and synthesis results that are kept."""

from splatcore.app.cli.options import command, option
from splatcore.sim.common import cache
from splatcore.sim.common.output import console
from splatcore.sim.common.table import Column, Table
from splatcore.spec.cache import cache_root


@command("cache")
def cache_command(empty: bool = option(False, None, "Delete everything in the cache.")) -> dict:
    """Show or clear the cache of compiled machines and synthesis results.

    Cleared entries are rebuilt on demand, which takes minutes per machine. The environment variable
    SPLATCORE_CACHE sets another folder.
    """
    root = cache_root()
    kept = cache.kept()
    sizes = {kind: sum(map(cache.size_of, paths)) for kind, paths in kept.items()}
    counts = {kind: sum(path.suffix != ".lock" for path in kept[kind]) for kind in kept}
    rows = [*((kind, counts[kind], sizes[kind] / 1e6) for kind in kept)]
    rows.append(("all", sum(counts.values()), sum(sizes.values()) / 1e6))
    columns = Column("kind"), Column("entries", digits=0), Column("MB", digits=1)
    Table("cache", "", columns, rows).print()
    if empty:
        cache.empty()
    console.print(f"{root}{': emptied' if empty else ''}")
    return {"folder": str(root), "bytes": sizes, "emptied": empty}
