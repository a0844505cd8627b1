/* DC motor that turns a load over an elastic shaft.
 *
 *     L di/dt   = v - R i - K w
 *     J dw/dt   = K i - B w - torque        torque = stiffness (angle - angle2) + damping (w - w2)
 *     J2 dw2/dt = torque - load
 *
 * For the tests of the integrator: linear, five states of which none is left alone, one motion that never dies away.
 */
#define MODEL_LINEAR 1

#define MODEL_VARIABLES(X) \
    X(state,     w2,        0,       100,  -1e9,  1e9,  "rad/s",     "Speed of the load") \
    X(state,     angle2,    0,       1,    -1e12, 1e12, "rad",       "Angle of the load") \
    X(input,     v,         0,       10,   -1e6,  1e6,  "V",         "Armature voltage") \
    X(input,     load,      0,       0.1,  -1e9,  1e9,  "N.m",       "Load torque") \
    X(parameter, R,         0.92,    1,    1e-6,  1e6,  "Ohm",       "Armature resistance") \
    X(parameter, K,         0.0735,  0.1,  1e-6,  1e6,  "V.s/rad",   "Back-EMF and torque constant") \
    X(parameter, L,         7.76e-3, 1e-3, 1e-9,  1e3,  "H",         "Armature inductance") \
    X(parameter, J,         1.36e-4, 1e-5, 1e-12, 1e6,  "kg.m2",     "Moment of inertia of the rotor") \
    X(parameter, B,         6.78e-4, 1e-4, 0,     1e6,  "N.m.s/rad", "Viscous friction coefficient") \
    X(parameter, J2,        5e-4,    1e-5, 1e-12, 1e6,  "kg.m2",     "Moment of inertia of the load") \
    X(parameter, stiffness, 20,      1,    0,     1e9,  "N.m/rad",   "Stiffness of the shaft") \
    X(parameter, damping,   1e-3,    1e-3, 0,     1e6,  "N.m.s/rad", "Damping of the shaft") \
    X(output,    torque,    0,       0.1,  -1e12, 1e12, "N.m",       "Torque in the shaft") \
    X(state,     i,         0,       1,    -1e9,  1e9,  "A",         "Armature current") \
    X(state,     w,         0,       100,  -1e9,  1e9,  "rad/s",     "Speed of the rotor") \
    X(state,     angle,     0,       1,    -1e12, 1e12, "rad",       "Angle of the rotor")

#include "model.h"

static void derivatives(const Variables *m, Derivatives *d)
{
    d->torque = m->stiffness * (m->angle - m->angle2) + m->damping * (m->w - m->w2);
    d->i = (m->v - m->R * m->i - m->K * m->w) / m->L;
    d->w = (m->K * m->i - m->B * m->w - d->torque) / m->J;
    d->w2 = (d->torque - m->load) / m->J2;
    d->angle = m->w;
    d->angle2 = m->w2;
}
