/* DC motor with a gear and an elastic shaft between motor and load.
 *
 *     L di/dt            = v - R i - K w
 *     J dw/dt            = K i - B w - torque / gear
 *     dangle/dt          = w
 *     J_load dw_load/dt  = torque - B_load w_load - load
 *     dangle_load/dt     = w_load
 *     torque             = stiffness (angle / gear - angle_load) + damping (w / gear - w_load)
 *
 * i, w and angle are the motor's; w_load and angle_load are the load's, behind the gear, which turns gear times slower.
 * The gear has no loss and no play; its inertia counts to J on the motor's side and to J_load on the other. stiffness
 * and damping are those of the shaft, the belt or the coupling, as seen from the load. With open terminals it swings at
 * sqrt(stiffness (1/J_load + 1/(gear^2 J))) rad/s. Speeds or angles of both sides must be measured to tell J, J_load and
 * stiffness apart.
 */

#define MODEL_LINEAR 1

/*    kind       name        start     nominal  min     max    unit           description */
#define MODEL_VARIABLES(X) \
    X(input,     v,          0,        10,      -1e6,   1e6,   "V",           "Armature voltage") \
    X(input,     load,       0,        1,       -1e9,   1e9,   "N.m",         "Load torque, against positive speed") \
    X(parameter, R,          3.1363,   1,       1e-6,   1e6,   "Ohm",         "Armature resistance") \
    X(parameter, K,          0.048774, 0.1,     1e-6,   1e6,   "V.s/rad",     "Back-EMF and torque constant") \
    X(parameter, L,          0.01307,  0.001,   1e-9,   1e3,   "H",           "Armature inductance") \
    X(parameter, J,          9e-6,     1e-5,    1e-12,  1e6,   "kg.m2",       "Moment of inertia of the rotor") \
    X(parameter, B,          1.69e-4,  1e-4,    0,      1e6,   "N.m.s/rad",   "Viscous friction coefficient of the motor") \
    X(parameter, gear,       5,        1,       1e-3,   1e6,   "1",           "Gear ratio: motor speed over load speed") \
    X(parameter, stiffness,  2,        1,       0,      1e9,   "N.m/rad",     "Stiffness of the shaft, load side") \
    X(parameter, damping,    1e-3,     1e-3,    0,      1e6,   "N.m.s/rad",   "Damping of the shaft, load side") \
    X(parameter, J_load,     5e-4,     1e-4,    1e-12,  1e6,   "kg.m2",       "Moment of inertia of the load") \
    X(parameter, B_load,     1e-3,     1e-4,    0,      1e6,   "N.m.s/rad",   "Viscous friction coefficient of the load") \
    X(state,     i,          0,        1,       -1e9,   1e9,   "A",           "Armature current") \
    X(state,     w,          0,        100,     -1e9,   1e9,   "rad/s",       "Speed of the motor") \
    X(state,     angle,      0,        1,       -1e12,  1e12,  "rad",         "Angle of the motor") \
    X(state,     w_load,     0,        10,      -1e9,   1e9,   "rad/s",       "Speed of the load") \
    X(state,     angle_load, 0,        1,       -1e12,  1e12,  "rad",         "Angle of the load") \
    X(output,    torque,     0,        1,       -1e12,  1e12,  "N.m",         "Torque in the shaft, load side")

#include "model.h"

static void derivatives(const Variables *m, Derivatives *d)
{
    d->torque = m->stiffness * (m->angle / m->gear - m->angle_load) + m->damping * (m->w / m->gear - m->w_load);
    d->i = (m->v - m->R * m->i - m->K * m->w) / m->L;
    d->w = (m->K * m->i - m->B * m->w - d->torque / m->gear) / m->J;
    d->angle = m->w;
    d->w_load = (d->torque - m->B_load * m->w_load - m->load) / m->J_load;
    d->angle_load = m->w_load;
}
