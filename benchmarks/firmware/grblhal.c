/* Between grblHAL's simulator and the carriage: by its count, whose jumps are no motion. */

#include <stdlib.h>

#include "driver.h"
#include "grbl/hal.h"
#include "mcu.h"

#define JUMP 16 /* more steps than that at once are a new count: homing, reset */

extern int carriage_made(int axis, int steps);

void carriage_tick(void)
{
    static int32_t counted[3];
    static int was = -1;
    int pins = 0;

    for (int axis = 0; axis < 3; axis++) {
        int32_t made = sys.position[axis] - counted[axis];
        counted[axis] = sys.position[axis];
        pins = carriage_made(axis, abs(made) <= JUMP ? made : 0);
    }
    if (pins != was)
        mcu_gpio_in(&gpio[LIMITS_PORT0], was = pins, 7);
}
