/* Computes a camera's register values, in user space: C99 with -lm. Apache-2.0. */
#include "splatcore_camera.h"

static void put(struct splatcore_view *view, uint32_t address, uint32_t value)
{
    view->words[(address - SPLATCORE_VIEW_AT) / 4] = value;
}

static int16_t header_field(const uint8_t *model, uint32_t at)
{
    return (int16_t)(model[at] | model[at + 1] << 8);
}

static double larger(double a, double b)
{
    return a > b ? a : b;
}

/* Write the camera's position in steps of the model's grid: two registers per coordinate. */
static void put_place(struct splatcore_view *view, const struct splatcore_camera *camera,
                      int grid_exponent)
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
        place = rint(ldexp(place, -grid_exponent));
        uint64_t steps = (uint64_t)(int64_t)place;
        put(view, registers[axis][0], (uint32_t)steps);
        put(view, registers[axis][1], (uint32_t)(steps >> 32) & SPLATCORE_CAMERA_X_HIGH_MASK);
    }
}

/* Write the constants of the projection: intrinsics and rotation. */
static void put_lens(struct splatcore_view *found, const struct splatcore_camera *camera,
                     int factor_exponent)
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
            put(found, view[row][k], splatcore_number(value));
            put(found, factor[row][k], splatcore_number(ldexp(value, factor_exponent)));
        }
    for (int axis = 0; axis < 2; axis++) {
        double principal = centre[axis] - SPLATCORE_PRINCIPAL_POINT_SHIFT;
        double guard = larger(size[axis] - 1 - principal, principal) + SPLATCORE_EXTENT_MARGIN;
        double limit = SPLATCORE_FRUSTUM_MARGIN * size[axis] / 2 * unit;
        const double values[4] = {
            guard * SPLATCORE_GUARD_FACTOR * unit, hypot(focal[axis], limit), limit, principal * unit,
        };
        for (int k = 0; k < 4; k++)
            put(found, screen[axis][k], splatcore_number(values[k]));
#ifdef SPLATCORE_CONSTANT_SURROUND
        if (axis == 0)
            put(found, SPLATCORE_CONSTANT_SURROUND,
                splatcore_number(SPLATCORE_SURROUND_MARGIN *
                                 larger(values[1], values[0] + focal[0])));
#endif
    }
#ifdef SPLATCORE_CONSTANT_LOD
    put(found, SPLATCORE_CONSTANT_LOD,
        splatcore_number(camera->lod_pixels / larger(camera->fx, camera->fy)));
#endif
    put(found, SPLATCORE_NEAR_PLANE,
        splatcore_number_below(camera->near > 0 ? camera->near : SPLATCORE_NEAR));
}

void splatcore_look(struct splatcore_view *view, const struct splatcore_camera *camera,
                    const uint8_t *model, const double background[3])
{
    view->width = camera->width;
    view->height = camera->height;
#ifdef SPLATCORE_FORMAT
    view->format = 0;
#endif
    put_place(view, camera, header_field(model, SPLATCORE_MODEL_POSITION_EXPONENT_AT));
    put_lens(view, camera, header_field(model, SPLATCORE_MODEL_FACTOR_EXPONENT_AT));
    for (uint32_t k = 0; k < 3; k++) {
        double part = rint(background[k] * SPLATCORE_BACKGROUND_FULL);
        put(view, SPLATCORE_BACKGROUND_RED + 4 * k, (uint32_t)part);
    }
}
