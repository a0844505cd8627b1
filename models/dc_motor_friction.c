/* Permanent-magnet DC motor with dry friction that holds it at standstill, and brushes that drop voltage.
 *
 *     L di/dt     = v - R i - K w - sign(i) brush
 *     J dw/dt     = K i - B w - load - sign(w) friction
 *     dangle/dt   = w
 *     w = 0 holds as long as |K i - load| <= friction + stiction
 *     i = 0 holds as long as |v - K w| <= brush
 *
 * friction is the Coulomb friction: a torque against the motion whatever the speed. At standstill it is as large as it
 * must be, up to friction + stiction, the torque at which the motor breaks away. A motor that is stopped stays at zero to
 * the last bit, until it breaks away at the instant at which the current suffices. brush is the voltage drop over both
 * brushes together, some 0.5 V for copper and 2 V for carbon, 0 where it is small or part of R. motion and conduction
 * are 1 or -1 for the way of speed and current, 0 where they are held at zero, 2 where nothing could hold them.
 */

#define MODEL_LINEAR 1

/*    kind       name        start     nominal  min     max    unit           description */
#define MODEL_VARIABLES(X) \
    X(input,     v,          0,        10,      -1e6,   1e6,   "V",           "Armature voltage") \
    X(input,     load,       0,        0.1,     -1e9,   1e9,   "N.m",         "Load torque, against positive speed") \
    X(parameter, R,          3.1363,   1,       1e-6,   1e6,   "Ohm",         "Armature resistance") \
    X(parameter, K,          0.048774, 0.1,     1e-6,   1e6,   "V.s/rad",     "Back-EMF and torque constant") \
    X(parameter, L,          0.01307,  0.001,   1e-9,   1e3,   "H",           "Armature inductance") \
    X(parameter, J,          9e-6,     1e-5,    1e-12,  1e6,   "kg.m2",       "Moment of inertia of rotor and load") \
    X(parameter, B,          5e-5,     1e-4,    0,      1e6,   "N.m.s/rad",   "Viscous friction coefficient") \
    X(parameter, friction,   0.01,     0.01,    0,      1e6,   "N.m",         "Coulomb friction torque") \
    X(parameter, stiction,   0,        0.01,    0,      1e6,   "N.m",         "Torque to break away, above friction") \
    X(parameter, brush,      0,        1,       0,      1e3,   "V",           "Voltage drop over the brushes") \
    X(state,     i,          0,        1,       -1e9,   1e9,   "A",           "Armature current") \
    X(state,     w,          0,        100,     -1e9,   1e9,   "rad/s",       "Speed of the shaft") \
    X(state,     angle,      0,        1,       -1e12,  1e12,  "rad",         "Angle of the shaft") \
    X(mode,      motion,     0,        1,       -1,     2,     "1",           "Way of the speed, 0 at standstill") \
    X(mode,      conduction, 0,        1,       -1,     2,     "1",           "Way of the current, 0 where it is blocked")

#include "model.h"

static void derivatives(const Variables *m, Derivatives *d)
{
    const double voltage = m->v - m->R * m->i - m->K * m->w - m->conduction * m->brush;
    const double torque = m->K * m->i - m->B * m->w - m->load - m->motion * m->friction;
    d->i = m->conduction == 0 ? 0 : voltage / m->L;
    d->w = m->motion == 0 ? 0 : torque / m->J;
    d->angle = m->w;
}

static void switches(const Variables *m, Switches *s)
{
    s->motion = dry_friction(m->motion, m->w, m->K * m->i - m->load, m->friction + m->stiction);
    s->conduction = dry_friction(m->conduction, m->i, m->v - m->K * m->w, m->brush);
}

static void enter(Variables *m)
{
    if (m->motion == 0) m->w = 0;
    if (m->conduction == 0) m->i = 0;
}
