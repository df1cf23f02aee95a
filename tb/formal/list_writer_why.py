"""Why the list writer has its properties: induction invariants on the contents of its registers."""

from amaranth.hdl import Array, Assert, Cat, Module, Mux, Signal, Value

from splatcore.hdl.binning.list_writer import State


def why(proof, m: Module) -> None:
    """Assert the invariants, in terms of `tb.formal.list_writer.Written`."""
    rows = _in_table(proof, m)
    _phases(proof, m)
    _held(proof, m, rows)
    _slot(proof, m, rows)


def _in_table(proof, m: Module) -> list[Signal]:
    """Check the table and return its rows: lists without the held entry, or 0 once flushed."""
    part, rows = proof.inner, []
    clearing, taking = part.state == State.CLEAR, part.state == State.TAKE
    flushing, done = part.state == State.FLUSH, part.state == State.DONE
    through = _asked(proof) - part.full  # groups that are flushed
    for g, one in enumerate(proof.lists):
        row = Signal(part.row, name=f"in_table{g}")
        before = taking & part.full & (part.held.group == g)
        over = done | (flushing & (g < through))
        m.d.comb += row.eq(Mux(before, proof.row_before, Mux(over, 0, one)))
        same = Value.cast(part.rows[g]) == Value.cast(row)
        m.d.comb += Assert((clearing & (part.group <= g)) | same)
        m.d.comb += Assert((one.count == 0) == (one.position == 0))
        m.d.comb += Assert((one.count != 0) | (Value.cast(one) == 0))
        m.d.comb += Assert((one.count == 0) | (one.page < proof.taken))
        m.d.comb += Assert((one.count == 0) | (one.inside == (one.page < part.pages)))
        m.d.comb += Assert((one.count == 0) | (g < part.groups_count))
        rows.append(row)
    return rows


def _asked(proof) -> Value:
    """Return the number of groups whose flush was requested."""
    return Mux(proof.inner.flushed, proof.inner.groups_count, proof.inner.group)


def _phases(proof, m: Module):
    part = proof.inner
    clearing, taking = part.state == State.CLEAR, part.state == State.TAKE
    flushing, done = part.state == State.FLUSH, part.state == State.DONE
    lists = Cat(Value.cast(one) for one in proof.lists)
    nothing = Cat(lists, proof.seen, proof.written, proof.taken, part.full, part.flushed) == 0
    asked, had = _asked(proof), part.had_burst | part.had_group
    m.d.comb += [
        Assert(~clearing | (nothing & (part.group < part.count))),
        Assert(flushing | done | (proof.given == 0)),
        Assert(~taking | ((part.group == 0) & ~part.flushed)),
        Assert(~flushing | (part.flushed | (part.group < part.groups_count))),
        Assert(~part.flushed | (part.group == part.groups_count[: len(part.group)])),
        Assert(~flushing | (proof.given == asked - part.full + part.had_group)),
        Assert(~flushing | ~part.full | (part.held.group + 1 == asked)),
        Assert(~flushing | ~part.flushed | part.full),
        Assert(~done | ~part.full),
        Assert(~had | (flushing & part.full)),
        Assert(~part.had_burst | ~part.had_group),
    ]


def _held(proof, m: Module, rows: list[Signal]):
    """The held entry: its group's row and slots equal those in memory."""
    part, before = proof.inner, proof.row_before
    most, group = (1 << proof.page_bits) - 1, part.held.group
    full = part.full & (part.state == State.TAKE)
    turn = (before.count == 0) | before.position.all()
    number = Mux(proof.taken_before > most, most, proof.taken_before)
    now = Signal(part.row)
    m.d.comb += now.eq(Array(Value.cast(one) for one in proof.lists)[group])
    further = proof.taken_before + (turn & (proof.taken_before <= most))
    m.d.comb += [
        Assert(~part.full | (group < part.groups_count)),
        Assert(~full | (part.needed == number)),
        Assert(~full | (part.exceeded == (proof.taken_before > part.pages))),
        Assert(~full | (proof.taken == further)),
        Assert(proof.taken <= most + 1),
        Assert(~full | (now.page == Mux(turn, number, before.page))),
        Assert(~full | (now.inside == (now.page < part.pages))),
        Assert(~full | (now.position == Mux(turn, 1, before.position + 1))),
        Assert(~full | (now.first == Mux(before.count == 0, number, before.first))),
        Assert(~full | (now.count == before.count + 1)),
        Assert(~full | ~before.count.all()),
        Assert(~full | ((before.count == 0) == (before.position == 0))),
        Assert(~full | (before.count != 0) | (Value.cast(before) == 0)),
        Assert(~full | (before.count == 0) | (before.page < proof.taken_before)),
        Assert(~full | (before.count == 0) | (before.inside == (before.page < part.pages))),
    ]
    row = part.found_row
    m.d.comb += Assert(~part.full | ~part.clash | part.same)
    m.d.comb += Assert(~part.full | (Value.cast(row) == Array(map(Value.cast, rows))[group]))
    for slot, buffer in zip(part.found_slots, part.buffers, strict=True):
        m.d.comb += Assert(~part.full | (slot == Array(buffer)[group]))
    flushing = part.full & (part.state == State.FLUSH)
    had = flushing & part.had_burst
    offset = row.position[: proof.burst_bits]
    m.d.comb += Assert(~had | ((offset != 0) & (row.page < part.pages)))


def _slot(proof, m: Module, rows: list[Signal]):
    """The followed slot: its value is in memory, in a buffer, or about to enter one."""
    part, before, bits = proof.inner, proof.row_before, proof.burst_bits
    seen, written, slot = proof.seen, proof.written, proof.slot
    full = part.full & (part.state == State.TAKE)
    flushing = part.full & (part.state == State.FLUSH)
    burst = slot[bits:]
    m.d.comb += Assert(~seen & ~written | (proof.page < proof.taken))
    m.d.comb += Assert(proof.owner < part.count)
    early = written | (seen & ~proof.latest)
    m.d.comb += Assert(~full | ~early | (proof.page < proof.taken_before))
    mine = [(row.count != 0) & (row.page == proof.page) for row in rows]
    lists = [(one.count != 0) & (one.page == proof.page) for one in proof.lists]
    for g, row in enumerate(rows):
        here, beyond = row.position[bits:] == burst, row.position[bits:] > burst
        given = flushing & part.had_burst & (part.held.group == g)
        m.d.comb += Assert(~written | ~mine[g] | beyond | (given & here))
        m.d.comb += Assert(~mine[g] | ~given | ~here | written)
        m.d.comb += Assert(seen | ~mine[g] | (row.position <= slot))
        m.d.comb += Assert(seen | ~lists[g] | (proof.lists[g].position <= slot))
        for other in range(len(rows)):
            if other != g:
                m.d.comb += Assert(~lists[g] | ~(mine[other] | lists[other]))
    coming, fresh = full & proof.latest, before.count == 0
    turn, number = fresh | before.position.all(), proof.taken_before
    old = ~fresh & (before.page == proof.page)
    link = old & before.position.all() & slot.all() & (proof.value == part.needed)
    first = turn & (number == proof.page) & (slot == 0)
    next_ = old & ~turn & (before.position == slot)
    entry = proof.value == Value.cast(part.held.entry)
    m.d.comb += Assert(~coming | (seen & ~written & (proof.owner == part.held.group)))
    m.d.comb += Assert(~coming | link | ((first | next_) & entry))
    m.d.comb += Assert(seen | ~full | ~old | (before.position != slot))
    # In its owner's buffer.
    row, owned = Signal(part.row), seen & ~written & ~coming
    offset, my = Signal(bits), slot[:bits]
    m.d.comb += row.eq(Array(map(Value.cast, rows))[proof.owner])
    m.d.comb += offset.eq(row.position[:bits])
    place = (row.count != 0) & (row.page == proof.page) & (row.position[bits:] == burst)
    m.d.comb += Assert(~owned | (place & (offset > my)))
    stored = Array(Array(buffer)[proof.owner] for buffer in part.buffers)[my]
    m.d.comb += Assert(~owned | (stored == proof.value))
