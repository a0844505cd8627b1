/* A ball that bounces, by Euler's method at steps of 10 ms: a bounce falls into one step or the next.
 *
 *     v += g dt,  h += v dt,  and where h < 0: h = 0, v = -e v
 *
 * The height jumps as g and e move: it is no smooth function of them.
 */
#define MODEL_LINEAR 1

#define MODEL_VARIABLES(X) \
    X(parameter, g,     -9.81, 10,   -100, 0,   "m/s2", "Acceleration of gravity") \
    X(parameter, e,     0.7,   1,    0.1,  1,   "1",    "Speed after a bounce over the speed before") \
    X(state,     clock, 0,     1,    0,    1e6, "s",    "Time") \
    X(output,    h,     1,     1,    -1,   10,  "m",    "Height")

#include "model.h"

static void derivatives(const Variables *m, Derivatives *d)
{
    const double dt = 0.01;
    double h = 1, v = 0;
    for (int k = (int)floor(m->clock / dt + 0.5); k > 0; --k) {
        v += m->g * dt;
        h += v * dt;
        if (h < 0) {
            h = 0;
            v = -m->e * v;
        }
    }
    d->clock = 1;
    d->h = h;
}
