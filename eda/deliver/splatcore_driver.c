/* Driver of Splatcore; splatcore_driver.h explains its functions. Apache-2.0. */
#include "splatcore_driver.h"

/* Clear all events and ERROR; events first, so that an error that follows sets its bit again. */
static void clear(void *device)
{
    splatcore_write(device, SPLATCORE_INTERRUPT, SPLATCORE_INTERRUPT_MASK);
    splatcore_write(device, SPLATCORE_ERROR, 0);
}

int32_t splatcore_open(void *device)
{
    if (splatcore_read(device, SPLATCORE_ID) != SPLATCORE_ID_VALUE ||
        splatcore_read(device, SPLATCORE_VERSION) != SPLATCORE_VERSION_VALUE ||
        splatcore_read(device, SPLATCORE_PICTURE_MAX) != SPLATCORE_PICTURE_MAX_VALUE)
        return SPLATCORE_NO_DEVICE;
    splatcore_write(device, SPLATCORE_INTERRUPT_ENABLE, 0);
    clear(device);
    return 0;
}

/* Abort all frames, so that no late frame writes to memory. */
static int32_t timeout(void *device)
{
    splatcore_write(device, SPLATCORE_CONTROL, SPLATCORE_CONTROL_ABORT);
    return SPLATCORE_TIMEOUT;
}

int32_t splatcore_ready(void *device, uint32_t pauses)
{
    splatcore_write(device, SPLATCORE_INTERRUPT_ENABLE, SPLATCORE_INTERRUPT_READY);
    for (;;) {
        /* Clear before STATUS is read: if READY rises after the read, the bit is set again. */
        splatcore_write(device, SPLATCORE_INTERRUPT, SPLATCORE_INTERRUPT_READY);
        if (splatcore_read(device, SPLATCORE_STATUS) & SPLATCORE_STATUS_READY)
            return 0;
        if (pauses-- == 0)
            return timeout(device);
        splatcore_pause(device);
    }
}

/* Write an address to its register, or to its two registers. */
#if SPLATCORE_ADDRESS_BITS > 32
#define WRITE_ADDRESS(name, address) \
    (splatcore_write(device, SPLATCORE_##name, (uint32_t)(address)), \
     splatcore_write(device, SPLATCORE_##name##_HIGH, (uint32_t)((address) >> 32)))
#else
#define WRITE_ADDRESS(name, address) splatcore_write(device, SPLATCORE_##name, address)
#endif

/* Write the addresses of all areas; work area 1 follows work area 0. */
static void write_memory(void *device, const struct splatcore_memory *memory)
{
    const uint32_t pages = memory->pages, features = memory->features;

    WRITE_ADDRESS(MODEL, memory->model);
    WRITE_ADDRESS(GROUPS, memory->work);
    WRITE_ADDRESS(LISTS, memory->work + SPLATCORE_LISTS_AT);
    WRITE_ADDRESS(FEATURES, memory->work + SPLATCORE_FEATURES_AT(pages));
    splatcore_write(device, SPLATCORE_WORK_AREA, SPLATCORE_WORK_BYTES(pages, features));
    splatcore_write(device, SPLATCORE_LISTS_PAGES, pages);
    splatcore_write(device, SPLATCORE_FEATURES_MAX, features);
    WRITE_ADDRESS(SCRATCH, memory->scratch);
    WRITE_ADDRESS(PIXELS, memory->image);
}

/* Write STRIDE, and FORMAT if it exists. */
static void write_rows(void *device, const struct splatcore_view *view)
{
    uint32_t stride = SPLATCORE_STRIDE_BYTES(view->width);

#ifdef SPLATCORE_FORMAT
    if (view->format & SPLATCORE_FORMAT_RGBA)
        stride = SPLATCORE_RGBA_STRIDE_BYTES(view->width);
    splatcore_write(device, SPLATCORE_FORMAT, view->format);
#endif
    splatcore_write(device, SPLATCORE_STRIDE, stride);
}

int32_t splatcore_start(void *device, const struct splatcore_memory *memory,
                        const struct splatcore_view *view)
{
    if (view->width - 1 >= SPLATCORE_SIDE_MAX || view->height - 1 >= SPLATCORE_SIDE_MAX ||
        SPLATCORE_GROUPS_ALONG(view->width) * SPLATCORE_GROUPS_ALONG(view->height) >
            SPLATCORE_GROUPS_MAX_VALUE)
        return SPLATCORE_NO_FRAME;
    write_memory(device, memory);
    splatcore_write(device, SPLATCORE_WIDTH, view->width);
    splatcore_write(device, SPLATCORE_HEIGHT, view->height);
    write_rows(device, view);
    for (uint32_t k = 0; k < SPLATCORE_VIEW_WORDS; k++)
        splatcore_write(device, SPLATCORE_VIEW_AT + 4 * k, view->words[k]);
    splatcore_write(device, SPLATCORE_CONTROL, SPLATCORE_CONTROL_START);
    return 0;
}

/* Return and clear ERROR. Its bit in INTERRUPT is cleared first, so that a later error sets the bit
 * again; if that error precedes the write of ERROR, the next call finds ERROR to be 0. */
static int32_t take_error(void *device)
{
    splatcore_write(device, SPLATCORE_INTERRUPT, SPLATCORE_INTERRUPT_ERROR);
    uint32_t error = splatcore_read(device, SPLATCORE_ERROR);
    splatcore_write(device, SPLATCORE_ERROR, error);
    return (int32_t)(error ? error : SPLATCORE_ERROR_UNKNOWN);
}

int32_t splatcore_wait(void *device, uint32_t events, uint32_t pauses)
{
    splatcore_write(device, SPLATCORE_INTERRUPT_ENABLE, events | SPLATCORE_INTERRUPT_ERROR);
    for (;;) {
        uint32_t now = splatcore_read(device, SPLATCORE_INTERRUPT);
        if (now & SPLATCORE_INTERRUPT_ERROR)
            return take_error(device);
        if (now & events) {
            splatcore_write(device, SPLATCORE_INTERRUPT, now & events);
            return 0;
        }
        if (pauses-- == 0)
            return timeout(device);
        splatcore_pause(device);
    }
}

int32_t splatcore_finished(void *device, uint32_t frames, uint32_t pauses)
{
    while (!((frames - splatcore_read(device, SPLATCORE_FINISHED) - 1) & 0x8000)) {
        int32_t failed = splatcore_wait(device, SPLATCORE_INTERRUPT_FRAME, pauses);
        if (failed)
            return failed;
    }
    return 0;
}

/* To overlap frames, start the next frame, with another image, when READY is high, then wait for
 * FINISHED. */
int32_t splatcore_frame(void *device, struct splatcore_memory *memory,
                        const struct splatcore_view *view, uint32_t pages_max, uint32_t pauses)
{
    for (;;) {
        int32_t failed = splatcore_ready(device, pauses);
        clear(device);
        if (!failed)
            failed = splatcore_start(device, memory, view);
        if (!failed)
            failed = splatcore_wait(device, SPLATCORE_INTERRUPT_FRAME, pauses);
        if (failed < 0 || (failed & (int32_t)SPLATCORE_ERROR_CODE_MASK) != SPLATCORE_ERROR_PAGES)
            return failed;
        uint32_t needed = splatcore_read(device, SPLATCORE_NEEDED);
        if (needed > pages_max || needed <= memory->pages) /* NEEDED saturates at its mask */
            return failed;
        memory->pages = needed;
    }
}
