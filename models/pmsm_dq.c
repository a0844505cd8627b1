/* Permanent-magnet synchronous motor in rotor coordinates, fed by an inverter.
 *
 *     Ld did/dt = vd - R id + we Lq iq
 *     Lq diq/dt = vq - R iq - we (Ld id + flux)           we = poles w
 *     J dw/dt   = torque - B w - load                     torque = 3/2 poles (flux iq + (Ld - Lq) id iq)
 *     dangle/dt = w
 *
 * vd and vq are the voltages that the inverter applies, in rotor coordinates with the amplitude-invariant transform:
 * their mean over a switching period, as the controller commands them. d is the direction of the magnets' flux. poles
 * is the number of pole pairs. i is the length of the current vector, the peak of the phase currents. An inverter's dead
 * time and voltage drop are no part of the model: where the commands are recorded, they appear as resistance.
 */

#define MODEL_LINEAR 0

/*    kind       name    start    nominal  min     max    unit           description */
#define MODEL_VARIABLES(X) \
    X(input,     vd,     0,       10,      -1e6,   1e6,   "V",           "Voltage in the direction of the flux") \
    X(input,     vq,     0,       10,      -1e6,   1e6,   "V",           "Voltage across the flux") \
    X(input,     load,   0,       1,       -1e9,   1e9,   "N.m",         "Load torque, against positive speed") \
    X(parameter, R,      0.5,     1,       1e-6,   1e6,   "Ohm",         "Resistance of a phase") \
    X(parameter, Ld,     1e-3,    1e-3,    1e-9,   1e3,   "H",           "Inductance in the direction of the flux") \
    X(parameter, Lq,     1.5e-3,  1e-3,    1e-9,   1e3,   "H",           "Inductance across the flux") \
    X(parameter, flux,   0.01,    0.01,    1e-9,   1e3,   "Wb",          "Flux linkage of the magnets") \
    X(parameter, poles,  4,       1,       1,      1e3,   "1",           "Number of pole pairs") \
    X(parameter, J,      5e-5,    1e-5,    1e-12,  1e6,   "kg.m2",       "Moment of inertia of rotor and load") \
    X(parameter, B,      1e-4,    1e-4,    0,      1e6,   "N.m.s/rad",   "Viscous friction coefficient") \
    X(state,     id,     0,       1,       -1e9,   1e9,   "A",           "Current in the direction of the flux") \
    X(state,     iq,     0,       1,       -1e9,   1e9,   "A",           "Current across the flux") \
    X(state,     w,      0,       100,     -1e9,   1e9,   "rad/s",       "Speed of the shaft") \
    X(state,     angle,  0,       1,       -1e12,  1e12,  "rad",         "Angle of the shaft") \
    X(output,    i,      0,       1,       0,      1e12,  "A",           "Length of the current vector") \
    X(output,    torque, 0,       1,       -1e12,  1e12,  "N.m",         "Torque of the motor")

#include "model.h"

static void derivatives(const Variables *m, Derivatives *d)
{
    const double we = m->poles * m->w;
    d->torque = 1.5 * m->poles * (m->flux + (m->Ld - m->Lq) * m->id) * m->iq;
    d->i = sqrt(m->id * m->id + m->iq * m->iq);
    d->id = (m->vd - m->R * m->id + we * m->Lq * m->iq) / m->Ld;
    d->iq = (m->vq - m->R * m->iq - we * (m->Ld * m->id + m->flux)) / m->Lq;
    d->w = (d->torque - m->B * m->w - m->load) / m->J;
    d->angle = m->w;
}
