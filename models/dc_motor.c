/* Permanent-magnet DC motor with a rigid shaft.
 *
 *     L di/dt     = v - R i - K w
 *     J dw/dt     = K i - B w - load
 *     dangle/dt   = w
 *
 * K is the back-EMF constant (V.s/rad) and the torque constant (N.m/A): one number in SI units.
 * B w is the friction torque; load is any further torque against positive speed.
 * Start values: Mavilor CML-050.
 */

#define MODEL_LINEAR 1

/*    kind       name   start     nominal  min     max    unit           description */
#define MODEL_VARIABLES(X) \
    X(input,     v,     0,        10,      -1e6,   1e6,   "V",           "Armature voltage") \
    X(input,     load,  0,        0.1,     -1e9,   1e9,   "N.m",         "Load torque, against positive speed") \
    X(parameter, R,     3.1363,   1,       1e-6,   1e6,   "Ohm",         "Armature resistance") \
    X(parameter, K,     0.048774, 0.1,     1e-6,   1e6,   "V.s/rad",     "Back-EMF and torque constant") \
    X(parameter, L,     0.01307,  0.001,   1e-9,   1e3,   "H",           "Armature inductance") \
    X(parameter, J,     9e-6,     1e-5,    1e-12,  1e6,   "kg.m2",       "Moment of inertia of rotor and load") \
    X(parameter, B,     1.69e-4,  1e-4,    0,      1e6,   "N.m.s/rad",   "Viscous friction coefficient") \
    X(state,     i,     0,        1,       -1e9,   1e9,   "A",           "Armature current") \
    X(state,     w,     0,        100,     -1e9,   1e9,   "rad/s",       "Speed of the shaft") \
    X(state,     angle, 0,        1,       -1e12,  1e12,  "rad",         "Angle of the shaft")

#include "model.h"

static void derivatives(const Variables *m, Derivatives *d)
{
    d->i = (m->v - m->R * m->i - m->K * m->w) / m->L;
    d->w = (m->K * m->i - m->B * m->w - m->load) / m->J;
    d->angle = m->w;
}
