"""A host in C that drives a simulated register file with the C driver."""

MAIN = """\
#include <stdio.h>
#include "splatcore_camera.h"
struct machine {
    uint32_t id, version, ready_after, points, frame_after, need, error;
    uint32_t interrupt, enable, held, ready_in, frame_in, late, late_after;
};
static void fail(struct machine *machine, uint32_t error)
{
    machine->interrupt |= SPLATCORE_INTERRUPT_ERROR;
    machine->held = machine->held ? machine->held | (error & 0x30000) : error;
}
/* The error `late` follows the next read (late_after 1) or write (2) of ERROR. */
static void late(struct machine *machine, uint32_t access)
{
    if (machine->late_after == access) {
        machine->late_after = 0;
        fail(machine, machine->late);
    }
}
void splatcore_write(void *device, uint32_t address, uint32_t value)
{
    struct machine *machine = device;
    printf("%u %u\\n", address, value);
    switch (address) {
    case SPLATCORE_INTERRUPT: machine->interrupt &= ~value; break;
    case SPLATCORE_INTERRUPT_ENABLE: machine->enable = value; break;
    case SPLATCORE_ERROR: machine->held = 0; late(machine, 2); break;
    case SPLATCORE_CONTROL:
        if (value != SPLATCORE_CONTROL_START) break;
        machine->ready_in = machine->points;
        machine->frame_in = machine->frame_after;
    }
}
uint32_t splatcore_read(void *device, uint32_t address)
{
    struct machine *machine = device;
    uint32_t found = 0;
    switch (address) {
    case SPLATCORE_ID: return machine->id;
    case SPLATCORE_VERSION: return machine->version;
    case SPLATCORE_PICTURE_MAX: return SPLATCORE_PICTURE_MAX_VALUE;
    case SPLATCORE_STATUS: return machine->ready_in ? 0 : SPLATCORE_STATUS_READY;
    case SPLATCORE_INTERRUPT: return machine->interrupt;
    case SPLATCORE_ERROR: found = machine->held; late(machine, 1); return found;
    case SPLATCORE_NEEDED: found = machine->need; machine->need = 0; return found;
    }
    return 0;
}
/* Time passes only while the interrupt is low. */
void splatcore_pause(void *device)
{
    struct machine *machine = device;
    if (machine->interrupt & machine->enable) return;
    if (machine->ready_in && !--machine->ready_in)
        machine->interrupt |= SPLATCORE_INTERRUPT_READY;
    if (!machine->frame_in || --machine->frame_in) return;
    if (machine->need) fail(machine, SPLATCORE_ERROR_PAGES);
    else if (machine->error) fail(machine, machine->error);
    else machine->interrupt |= SPLATCORE_INTERRUPT_FRAME;
}
int main(void)
{
    const uint8_t model[] = {@MODEL@};
    const struct splatcore_camera camera = {@CAMERA@};
    const double background[3] = {0, 0.5, 1};
    struct splatcore_memory memory = {@MEMORY@, 7, 100};
    struct machine machine = {@MACHINE@};
    struct splatcore_view view;
    int32_t failed = splatcore_open(&machine);
    (void)memory;
    machine.ready_in = machine.ready_after;
    if (!failed) {
        splatcore_look(&view, &camera, model, background);
        @CALLS@
    }
    printf("%d\\n", (int)failed);
    return 0;
}
"""
"""The program, with `@...@` to fill in. It prints each register write, then the result."""
