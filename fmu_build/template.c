/* One sentence that says what this model is.
 *
 *     L di/dt = v - R i - K w
 *     J dw/dt = K i - B w
 *
 * Change the equations here, the table and the function below; then: fmu-estimator build NAME.c
 */

/* 1: the derivatives are linear in the states (then steps are exact); 0: they are not. */
#define MODEL_LINEAR 1

/* One line a variable, in SI units. Kinds: input; parameter; state (an output that is integrated); output (an output that
   is calculated). nominal is a typical size. To leave a line out, remove it: the table may hold no comments. */

/*    kind       name  start  nominal  min    max   unit         description */
#define MODEL_VARIABLES(X) \
    X(input,     v,    0,     10,      -1e6,  1e6,  "V",         "Armature voltage") \
    X(parameter, R,    1,     1,       1e-6,  1e6,  "Ohm",       "Armature resistance") \
    X(parameter, K,    0.05,  0.1,     1e-6,  1e6,  "V.s/rad",   "Back-EMF and torque constant") \
    X(parameter, L,    1e-3,  1e-3,    1e-9,  1e3,  "H",         "Armature inductance") \
    X(parameter, J,    1e-5,  1e-5,    1e-12, 1e6,  "kg.m2",     "Moment of inertia of rotor and load") \
    X(parameter, B,    1e-4,  1e-4,    0,     1e6,  "N.m.s/rad", "Viscous friction coefficient") \
    X(state,     i,    0,     1,       -1e9,  1e9,  "A",         "Armature current") \
    X(state,     w,    0,     100,     -1e9,  1e9,  "rad/s",     "Speed of the shaft") \
    X(output,    heat, 0,     1,       0,     1e12, "W",         "Heat from the winding")

#include "model.h"

/* From the values m to the derivatives of the states and the values of the calculated outputs. Every one is set, whatever
   the values; nothing is kept from call to call. */
static void derivatives(const Variables *m, Derivatives *d)
{
    d->i = (m->v - m->R * m->i - m->K * m->w) / m->L;
    d->w = (m->K * m->i - m->B * m->w) / m->J;
    d->heat = m->R * m->i * m->i;
}
