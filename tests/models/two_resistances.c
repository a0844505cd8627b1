/* A mass between two temperatures, behind a resistance each.
 *
 *     C dT/dt = (T1 - T) / R1 + (T2 - T) / R2
 *
 * R1, R2 and 1/C may be scaled together: nothing that T shows changes. `shown` is T with the irregular error that a solver
 * of its own adds, 2e-5 K: it depends on the parameters as noise does.
 */
#define MODEL_LINEAR 1

#define MODEL_VARIABLES(X) \
    X(input,     T1,    0,    10,   -1e6,  1e6,  "K",     "Temperature on one side") \
    X(input,     T2,    0,    10,   -1e6,  1e6,  "K",     "Temperature on the other side") \
    X(parameter, R1,    0.1,  1,    1e-6,  1e6,  "K/W",   "Resistance to one side") \
    X(parameter, R2,    0.25, 1,    1e-6,  1e6,  "K/W",   "Resistance to the other side") \
    X(parameter, C,     2000, 1000, 1e-6,  1e9,  "J/K",   "Heat capacity") \
    X(state,     T,     0,    10,   -1e6,  1e6,  "K",     "Temperature of the mass") \
    X(output,    shown, 0,    10,   -1e6,  1e6,  "K",     "The same, with a solver's error")

#include "model.h"

static void derivatives(const Variables *m, Derivatives *d)
{
    d->T = ((m->T1 - m->T) / m->R1 + (m->T2 - m->T) / m->R2) / m->C;
    d->shown = m->T + 2e-5 * sin(1e8 * (m->R1 + m->R2) + 1e4 * m->C + 1e3 * m->T);
}
