/* DC motor that drives a fan: a drag torque that grows with the square of the speed.
 *
 *     L di/dt = v - R i - K w
 *     J dw/dt = K i - B w - drag w |w|
 *
 * For the tests of the integrator: not linear, and stiff where L is small. Two outputs are calculated.
 */
#define MODEL_LINEAR 0

#define MODEL_VARIABLES(X) \
    X(parameter, R,      3.1363,   1,    1e-6,  1e6,  "Ohm",          "Armature resistance") \
    X(state,     w,      0,        100,  -1e9,  1e9,  "rad/s",        "Speed of the shaft") \
    X(input,     v,      0,        10,   -1e6,  1e6,  "V",            "Armature voltage") \
    X(parameter, K,      0.048774, 0.1,  1e-6,  1e6,  "V.s/rad",      "Back-EMF and torque constant") \
    X(output,    power,  0,        10,   -1e12, 1e12, "W",            "Electrical power") \
    X(parameter, L,      0.01307,  1e-3, 1e-9,  1e3,  "H",            "Armature inductance") \
    X(parameter, J,      9e-6,     1e-5, 1e-12, 1e6,  "kg.m2",        "Moment of inertia") \
    X(parameter, B,      1.69e-4,  1e-4, 0,     1e6,  "N.m.s/rad",    "Viscous friction coefficient") \
    X(parameter, drag,   1e-6,     1e-6, 0,     1e3,  "N.m.s2/rad2",  "Drag coefficient of the fan") \
    X(state,     i,      0,        1,    -1e9,  1e9,  "A",            "Armature current") \
    X(output,    torque, 0,        0.1,  -1e9,  1e9,  "N.m",          "Drag torque of the fan")

#include "model.h"

static void derivatives(const Variables *m, Derivatives *d)
{
    const double torque = m->drag * m->w * fabs(m->w);
    d->i = (m->v - m->R * m->i - m->K * m->w) / m->L;
    d->w = (m->K * m->i - m->B * m->w - torque) / m->J;
    d->power = m->v * m->i;
    d->torque = torque;
}
