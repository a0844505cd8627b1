/* A wave of unknown rate: over many turns nearly every rate fits as badly as any other, and the right one stands alone. */
#define MODEL_LINEAR 1

#define MODEL_VARIABLES(X) \
    X(parameter, rate,  10, 10, 1e-3, 1e6, "rad/s", "Rate of the wave") \
    X(parameter, size,  1,  1,  1e-3, 1e6, "m",     "Its amplitude") \
    X(state,     clock, 0,  1,  0,    1e6, "s",     "Time") \
    X(output,    y,     0,  1,  -1e6, 1e6, "m",     "The wave")

#include "model.h"

static void derivatives(const Variables *m, Derivatives *d)
{
    d->clock = 1;
    d->y = m->size * sin(m->rate * m->clock);
}
