/* One frame of Splatcore, from a host's side: where things lie, the camera's numbers, START, and
 * what may go wrong. C99, with -lm and splatcore.h (`splatcore registers -o DIR`).
 * Apache-2.0.
 *
 * The platform provides the first three functions. Caches are its matter too: what the host has
 * written must be in memory before START, and the image must be read from memory.
 */
#include <stdint.h>

#include "splatcore.h"

void splatcore_write(uint32_t address, uint32_t value);  /* a register */
uint32_t splatcore_read(uint32_t address);
void splatcore_sleep(void);  /* until the interrupt is high; may return earlier */

/* OpenCV axes: x right, y down, z forward. A world point w is seen at p = rotation · w +
 * translation and lands on (fx · p.x / p.z + cx, fy · p.y / p.z + cy) pixels. */
struct camera {
    uint32_t width, height;
    double fx, fy, cx, cy;
    double rotation[3][3], translation[3];
};

/* Physical addresses, multiples of 4096: a packed model, two work areas, scratch memory, an image;
 * and what there is room for in each area: list pages, features. */
struct memory {
    uint32_t model, work, scratch, image;
    uint32_t pages, features;
};

static int16_t header_field(const uint8_t *model, uint32_t at)
{
    return (int16_t)(model[at] | model[at + 1] << 8);
}

static double larger(double a, double b)
{
    return a > b ? a : b;
}

/* Where the parts lie: work area 1 behind work area 0. */
static void write_memory(const struct memory *memory)
{
    splatcore_write(SPLATCORE_MODEL, memory->model);
    splatcore_write(SPLATCORE_GROUPS, memory->work);
    splatcore_write(SPLATCORE_LISTS, memory->work + SPLATCORE_LISTS_AT);
    splatcore_write(SPLATCORE_FEATURES, memory->work + SPLATCORE_FEATURES_AT(memory->pages));
    splatcore_write(SPLATCORE_WORK_AREA, SPLATCORE_WORK_BYTES(memory->pages, memory->features));
    splatcore_write(SPLATCORE_LISTS_PAGES, memory->pages);
    splatcore_write(SPLATCORE_FEATURES_MAX, memory->features);
    splatcore_write(SPLATCORE_SCRATCH, memory->scratch);
    splatcore_write(SPLATCORE_PIXELS, memory->image);
}

/* The camera's place in steps of the model's grid, in two registers a coordinate. */
static void write_place(const struct camera *camera, int grid_exponent)
{
    static const uint32_t registers[3][2] = {
        {SPLATCORE_CAMERA_X_LOW, SPLATCORE_CAMERA_X_HIGH},
        {SPLATCORE_CAMERA_Y_LOW, SPLATCORE_CAMERA_Y_HIGH},
        {SPLATCORE_CAMERA_Z_LOW, SPLATCORE_CAMERA_Z_HIGH},
    };
    for (int axis = 0; axis < 3; axis++) {
        double place = 0;
        for (int k = 0; k < 3; k++)
            place -= camera->rotation[k][axis] * camera->translation[k];
        uint64_t steps = (uint64_t)(int64_t)rint(ldexp(place, -grid_exponent));
        splatcore_write(registers[axis][0], (uint32_t)steps);
        splatcore_write(registers[axis][1], (uint32_t)(steps >> 32) & SPLATCORE_CAMERA_X_HIGH_MASK);
    }
}

/* Intrinsics and rotation as the projection wants them. */
static void write_view(const struct camera *camera, int factor_exponent)
{
    static const uint32_t view[3][3] = {
        {SPLATCORE_CONSTANT_VX0, SPLATCORE_CONSTANT_VX1, SPLATCORE_CONSTANT_VX2},
        {SPLATCORE_CONSTANT_VY0, SPLATCORE_CONSTANT_VY1, SPLATCORE_CONSTANT_VY2},
        {SPLATCORE_CONSTANT_VZ0, SPLATCORE_CONSTANT_VZ1, SPLATCORE_CONSTANT_VZ2},
    }, factor[3][3] = {
        {SPLATCORE_CONSTANT_WX0, SPLATCORE_CONSTANT_WX1, SPLATCORE_CONSTANT_WX2},
        {SPLATCORE_CONSTANT_WY0, SPLATCORE_CONSTANT_WY1, SPLATCORE_CONSTANT_WY2},
        {SPLATCORE_CONSTANT_WZ0, SPLATCORE_CONSTANT_WZ1, SPLATCORE_CONSTANT_WZ2},
    }, screen[2][4] = {
        {SPLATCORE_CONSTANT_GUARD_X, SPLATCORE_CONSTANT_SPREAD_X,
         SPLATCORE_CONSTANT_LIMIT_X, SPLATCORE_CONSTANT_PRINCIPAL_X},
        {SPLATCORE_CONSTANT_GUARD_Y, SPLATCORE_CONSTANT_SPREAD_Y,
         SPLATCORE_CONSTANT_LIMIT_Y, SPLATCORE_CONSTANT_PRINCIPAL_Y},
    };
    const double unit = ldexp(1.0, -SPLATCORE_SCREEN_EXPONENT);
    const double focal[3] = {camera->fx * unit, camera->fy * unit, 1.0};
    const double size[2] = {camera->width, camera->height};
    const double centre[2] = {camera->cx, camera->cy};

    for (int row = 0; row < 3; row++)
        for (int k = 0; k < 3; k++) {
            double value = camera->rotation[row][k] * focal[row];
            splatcore_write(view[row][k], splatcore_number(value));
            splatcore_write(factor[row][k], splatcore_number(ldexp(value, factor_exponent)));
        }
    for (int axis = 0; axis < 2; axis++) {
        double principal = centre[axis] - SPLATCORE_PRINCIPAL_POINT_SHIFT;
        double guard = larger(size[axis] - 1 - principal, principal) + SPLATCORE_EXTENT_MARGIN;
        double limit = SPLATCORE_FRUSTUM_MARGIN * size[axis] / 2 * unit;
        const double values[4] = {
            guard * SPLATCORE_GUARD_FACTOR * unit, hypot(focal[axis], limit), limit, principal * unit,
        };
        for (int k = 0; k < 4; k++)
            splatcore_write(screen[axis][k], splatcore_number(values[k]));
    }
    splatcore_write(SPLATCORE_NEAR_PLANE, SPLATCORE_NEAR_PLANE_VALUE);
}

/* Begin a frame; only while STATUS says READY. model: the host's view of what lies at
 * memory->model; background: red, green, blue, 0 … 1. */
void splatcore_start(const struct camera *camera, const struct memory *memory,
                     const uint8_t *model, const double background[3])
{
    write_memory(memory);
    write_place(camera, header_field(model, SPLATCORE_MODEL_POSITION_EXPONENT_AT));
    write_view(camera, header_field(model, SPLATCORE_MODEL_FACTOR_EXPONENT_AT));
    splatcore_write(SPLATCORE_WIDTH, camera->width);
    splatcore_write(SPLATCORE_HEIGHT, camera->height);
    splatcore_write(SPLATCORE_STRIDE, SPLATCORE_STRIDE_BYTES(camera->width));
    for (uint32_t k = 0; k < 3; k++)
        splatcore_write(SPLATCORE_BACKGROUND_RED + 4 * k,
                        (uint32_t)rint(background[k] * SPLATCORE_BACKGROUND_FULL));
    splatcore_write(SPLATCORE_CONTROL, SPLATCORE_CONTROL_START);
}

/* Wait for one of these events; 0 if it came, else ERROR: a code, above it a detail, above that
 * the halves that have given up a frame. */
uint32_t splatcore_wait(uint32_t events)
{
    for (;;) {
        uint32_t now = splatcore_read(SPLATCORE_INTERRUPT);
        if (now & SPLATCORE_INTERRUPT_ERROR) {
            uint32_t error = splatcore_read(SPLATCORE_ERROR);
            splatcore_write(SPLATCORE_ERROR, error);
            splatcore_write(SPLATCORE_INTERRUPT, now);
            return error;
        }
        if (now & events) {
            splatcore_write(SPLATCORE_INTERRUPT, now & events);
            return SPLATCORE_ERROR_NONE;
        }
        splatcore_sleep();
    }
}

/* Render one frame into memory->image. A driver of several starts the next one when it has seen
 * READY, with another image, and waits for FRAME after that. */
uint32_t splatcore_frame(const struct camera *camera, struct memory *memory, uint32_t pages_max,
                         const uint8_t *model, const double background[3])
{
    splatcore_write(SPLATCORE_INTERRUPT, SPLATCORE_INTERRUPT_MASK);
    splatcore_write(SPLATCORE_INTERRUPT_ENABLE, SPLATCORE_INTERRUPT_MASK);
    for (;;) {
        while (!(splatcore_read(SPLATCORE_STATUS) & SPLATCORE_STATUS_READY))
            ;
        splatcore_start(camera, memory, model, background);
        uint32_t error = splatcore_wait(SPLATCORE_INTERRUPT_FRAME);
        if ((error & SPLATCORE_ERROR_CODE_MASK) != SPLATCORE_ERROR_PAGES)
            return error;
        /* Lists need more pages than there were: as many as the machine says, if there is room. */
        uint32_t needed = splatcore_read(SPLATCORE_NEEDED);
        if (needed > pages_max || needed <= memory->pages) /* it counts no further than its mask */
            return error;
        memory->pages = needed;
    }
}
