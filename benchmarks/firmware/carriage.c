/* A carriage with three end switches under grblHAL's simulator, which has none.

   It stands some way below its switches when power comes on, whatever the firmware counts, and goes
   by the steps that the firmware makes. A new count (homing, reset) is no motion. Switches are at
   the positive ends; each trips SCATTER steps early or late, another way at each approach. */

#include <stdlib.h>

#include "driver.h"
#include "grbl/hal.h"
#include "mcu.h"

#define STEPS_MM 800
#define JUMP 16 /* more steps than that at once are a new count */
#define SCATTER 8

static int32_t carriage[3] = {-20 * STEPS_MM, -20 * STEPS_MM, -10 * STEPS_MM};
static int32_t counted[3], trip[3];

void carriage_tick(void)
{
    static uint16_t pressed = 0;
    uint16_t pins = 0;

    for (int axis = 0; axis < 3; axis++) {
        int32_t made = sys.position[axis] - counted[axis];
        counted[axis] = sys.position[axis];
        if (abs(made) <= JUMP)
            carriage[axis] += made;
        if (carriage[axis] < -STEPS_MM / 2 && !(pressed >> axis & 1))
            trip[axis] = rand() % (2 * SCATTER + 1) - SCATTER;
        if (carriage[axis] >= trip[axis])
            pins |= 1 << axis;
    }
    if (pins != pressed) {
        pressed = pins;
        mcu_gpio_in(&gpio[LIMITS_PORT0], pins, 7);
    }
}
