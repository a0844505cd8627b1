/* DC motor with dry friction and brushes, behind a drive with a current limit and a dead band, at a supply that sags.
 *
 *     L di/dt     = u - R i - K w - sign(i) brush
 *     J dw/dt     = K i - B w - load - sign(w) (friction + stribeck_torque S(|w| / stribeck_speed))
 *     S(x) = 0.55 max(1 - x, 0) + 0.45 max(1 - x / 3.2, 0)
 *     dangle/dt   = w
 *     u = v - way sag,   way = sign(v),   where |v| > dead_band;   u = 0, way = 0 elsewhere
 *     with supply_series = 1:   way = 1 everywhere, u = - sag where |v| <= dead_band
 *     supply_time dsag/dt = supply_resistance way i - sag
 *     w = 0 holds as long as |K i - load| <= friction + stiction + stribeck_torque
 *     i = 0 holds as long as |u - K w| <= brush, and with coasts = 1 as long as |v| <= dead_band
 *     i = +-current_limit holds as long as u would drive it further; with limit_slope: u less (i -+ current_limit) /
 *     limit_slope where i is beyond it
 *     with one_way = 1:   i = 0 holds as long as way (u - K w) <= brush
 *
 * All but R, K, L, J and B have no effect unless they are set: without them, this is dc_motor; with friction, stiction and
 * brush alone, dc_motor_friction. What stiction is larger than friction is gone as soon as the motor moves. stribeck_torque
 * falls with the speed: S is within 0.07 of Stribeck's curve exp(-x), by lines, so that every mode is linear.
 *
 * The drive takes v as its command. A command of no more than dead_band gives no voltage: then it shorts the motor, or opens
 * the circuit where coasts is 1: the current is zero at once. It holds the current at current_limit by whatever voltage that
 * takes, or lets it rise by limit_slope for each volt that it takes away, as foldback does. It connects the supply to the motor the one way or the other: the source v behind supply_resistance, with a
 * capacitor that is charged to v before the motor draws current; supply_time is resistance times capacitance, 0 without a
 * capacitor. sag is what the current has taken off its voltage. A supply that is regulated, and dips only until it has
 * recovered, is one of negative resistance, with its size added to R. With supply_series it is an amplifier instead, whose
 * output sags by the motor's current whatever it is to give.
 *
 * With one_way the drive is a switch with diodes, or a supply that takes no current back: current flows only the way of the
 * command. What flows the other way, or at no voltage, ceases through the diodes; once it is zero, no voltage of the motor's
 * own drives it. A motor that is faster than its command coasts.
 *
 * motion and conduction are 1 or -1 for the way of speed and current, 0 where they are held at zero, 2 where nothing could
 * hold them. crawling and creeping are 1 at speeds below 1 and 3.2 times stribeck_speed. limiting is 1 where the current is
 * held at its limit, or beyond it, limiting_back where it is so at minus its limit. command is the way of the supply, 0 where there is
 * no voltage, 2 where it does not matter.
 */

#define MODEL_LINEAR 1

/*    kind       name               start     nominal  min     max    unit           description */
#define MODEL_VARIABLES(X) \
    X(input,     v,                 0,        10,      -1e6,   1e6,   "V",           "Voltage that the drive is to give") \
    X(input,     load,              0,        0.1,     -1e9,   1e9,   "N.m",         "Load torque, against positive speed") \
    X(parameter, R,                 3.1363,   1,       1e-6,   1e6,   "Ohm",         "Armature resistance") \
    X(parameter, K,                 0.048774, 0.1,     1e-6,   1e6,   "V.s/rad",     "Back-EMF and torque constant") \
    X(parameter, L,                 0.01307,  0.001,   1e-9,   1e3,   "H",           "Armature inductance") \
    X(parameter, J,                 9e-6,     1e-5,    1e-12,  1e6,   "kg.m2",       "Moment of inertia of rotor and load") \
    X(parameter, B,                 1.69e-4,  1e-4,    0,      1e6,   "N.m.s/rad",   "Viscous friction coefficient") \
    X(parameter, friction,          0,        0.01,    0,      1e6,   "N.m",         "Coulomb friction torque") \
    X(parameter, stiction,          0,        0.01,    0,      1e6,   "N.m",         "Torque to break away, above friction") \
    X(parameter, stribeck_torque,   0,        0.01,    0,      1e6,   "N.m",         "Friction at rest that falls with the speed") \
    X(parameter, stribeck_speed,    0,        10,      0,      1e6,   "rad/s",       "Speed at which a third of it is left") \
    X(parameter, brush,             0,        1,       0,      1e3,   "V",           "Voltage drop over the brushes") \
    X(parameter, current_limit,     1e9,      10,      1e-6,   1e9,   "A",           "Current that the drive lets pass; 1e9: any") \
    X(parameter, limit_slope,       0,        0.01,    0,      1e6,   "A/V",         "Current beyond the limit for a volt taken away") \
    X(parameter, dead_band,         0,        1,       0,      1e6,   "V",           "Command up to which there is no voltage") \
    X(parameter, coasts,            0,        1,       0,      1,     "1",           "Whether no voltage means no current, 0 or 1") \
    X(parameter, one_way,           0,        1,       0,      1,     "1",           "Whether no current flows back, 0 or 1") \
    X(parameter, supply_resistance, 0,        1,       -1e6,   1e6,   "Ohm",         "Resistance of the supply") \
    X(parameter, supply_time,       0,        0.01,    0,      1e6,   "s",           "Time constant of the supply") \
    X(parameter, supply_series,     0,        1,       0,      1,     "1",           "Whether it is in series at any command, 0 or 1") \
    X(state,     i,                 0,        1,       -1e9,   1e9,   "A",           "Armature current") \
    X(state,     w,                 0,        100,     -1e9,   1e9,   "rad/s",       "Speed of the shaft") \
    X(state,     angle,             0,        1,       -1e12,  1e12,  "rad",         "Angle of the shaft") \
    X(state,     sag,               0,        1,       -1e6,   1e6,   "V",           "Voltage that the supply has lost") \
    X(mode,      motion,            0,        1,       -1,     2,     "1",           "Way of the speed, 0 at standstill") \
    X(mode,      crawling,          0,        1,       0,      1,     "1",           "1 below stribeck_speed") \
    X(mode,      creeping,          0,        1,       0,      1,     "1",           "1 below 3.2 times stribeck_speed") \
    X(mode,      conduction,        0,        1,       -1,     2,     "1",           "Way of the current, 0 where it is blocked") \
    X(mode,      limiting,          0,        1,       0,      1,     "1",           "1 where the current is at its limit or beyond") \
    X(mode,      limiting_back,     0,        1,       0,      1,     "1",           "1 where it is so at minus its limit") \
    X(mode,      command,           2,        1,       -1,     2,     "1",           "Way of the supply, 0 where it is off")

#include "model.h"

#define NO_LIMIT 1e9 /* A */
#define STEEP 0.55   /* of stribeck_torque: what falls to nothing at stribeck_speed, by least squares */
#define FURTHER 3.2  /* times that speed: where the rest has fallen to nothing */

static bool is_open(const Variables *m)
{
    return m->command == 0 && m->coasts >= 0.5;
}

static bool is_one_way(const Variables *m)
{
    return m->one_way >= 0.5;
}

static bool is_in_series(const Variables *m)
{
    return m->supply_series >= 0.5;
}

/* The way of the supply, 0 where it is off or does not matter. */
static double way(const Variables *m)
{
    return is_in_series(m) ? 1 : m->command == UNHELD ? 0 : m->command;
}

static bool gives_way(const Variables *m)
{
    return m->limit_slope > 0;
}

/* What a limit that gives way takes off the voltage. */
static double taken_away(const Variables *m)
{
    if (!gives_way(m) || (m->limiting == 0 && m->limiting_back == 0)) return 0;
    return (m->i + (m->limiting != 0 ? -1 : 1) * m->current_limit) / m->limit_slope;
}

/* What drives the current, but for the brushes. */
static double driving_voltage(const Variables *m)
{
    const double sag = m->supply_time > 0 ? m->sag : m->supply_resistance * way(m) * m->i;
    const double u = (m->command == 0 ? 0 : m->v) - way(m) * sag - taken_away(m);
    return u - m->R * m->i - m->K * m->w;
}

/* The friction torque that falls with the speed, against the motion: on two lines, one of them to FURTHER times the speed. */
static double falling(const Variables *m)
{
    const double x = m->stribeck_speed > 0 ? m->w / m->stribeck_speed : 0;
    const double steep = m->crawling == 0 ? 0 : STEEP * (m->motion - x);
    return m->stribeck_torque * (steep + (m->creeping == 0 ? 0 : (1 - STEEP) * (m->motion - x / FURTHER)));
}

static void derivatives(const Variables *m, Derivatives *d)
{
    const double torque = m->K * m->i - m->B * m->w - m->load - m->motion * m->friction - falling(m);
    const bool limited = !gives_way(m) && (m->limiting != 0 || m->limiting_back != 0);
    const bool held = m->conduction == 0 || limited || is_open(m);
    const double drawn = m->supply_resistance * way(m) * m->i;
    d->i = held ? 0 : (driving_voltage(m) - m->conduction * m->brush) / m->L;
    d->w = m->motion == 0 ? 0 : torque / m->J;
    d->angle = m->w;
    d->sag = m->supply_time > 0 ? (drawn - m->sag) / m->supply_time : 0;
}

/* Which way the supply is commanded to be. */
static double commanded(const Variables *m)
{
    const bool bridged = m->supply_resistance != 0 && !is_in_series(m);
    const bool matters = m->dead_band > 0 || m->coasts >= 0.5 || is_one_way(m) || bridged;
    return !matters ? UNHELD : !(fabs(m->v) > m->dead_band) ? 0 : m->v > 0 ? 1 : -1;
}

/* Whether the speed is below one to which stribeck_torque matters. */
static Switch below(const Variables *m, double mode, double speed)
{
    const double margin = speed - fabs(m->w), way = mode == 0 ? -1 : 1;
    if (m->stribeck_torque == 0 || speed == 0) return lasting_switch(mode == 0 ? 1 : -1, 0);
    return (Switch){way * margin, mode == 0, .linear = way * (speed - m->motion * m->w), .most = INFINITY};
}

/* The limit of a current that flows the one way, 1, or the other, -1. */
static Switch limited(const Variables *m, double mode, double way)
{
    const double further = way * driving_voltage(m) - m->brush; /* V */
    if (m->current_limit >= NO_LIMIT || is_open(m)) return lasting_switch(mode == 0 ? 1 : -1, 0);
    const double below_limit = m->current_limit - way * m->i; /* A */
    if (gives_way(m)) return linear_switch(mode == 0 ? below_limit : -below_limit, mode == 0);
    Switch s = linear_switch(mode == 0 ? below_limit : further, mode == 0);
    if (mode == 0 && way * m->i == m->current_limit && further > 0) s.margin = -1;
    return s;
}

/* The way of a current that the drive lets flow the way of the command only. */
static Switch flowing_one_way(const Variables *m)
{
    const double flows = m->i > 0 ? 1 : m->i < 0 ? -1 : 0;
    if (m->conduction == UNHELD) return lasting_switch(-1, flows);
    if (m->conduction != 0) return linear_switch(m->conduction * m->i, 0);
    if (m->command == 0 || m->command == UNHELD) return lasting_switch(flows == 0 ? 1 : -1, flows);
    Switch s = linear_switch(m->brush - m->command * driving_voltage(m), m->command);
    if (flows != 0) s = lasting_switch(-fabs(m->i), flows); /* it was set to flow */
    return s;
}

static void switches(const Variables *m, Switches *s)
{
    const double command = commanded(m);
    s->motion = dry_friction(m->motion, m->w, m->K * m->i - m->load, m->friction + m->stiction + m->stribeck_torque);
    s->crawling = below(m, m->crawling, m->stribeck_speed);
    s->creeping = below(m, m->creeping, FURTHER * m->stribeck_speed);
    s->conduction = is_one_way(m) ? flowing_one_way(m) : dry_friction(m->conduction, m->i, driving_voltage(m), m->brush);
    if (is_open(m) && (m->brush > 0 || is_one_way(m))) s->conduction = lasting_switch(m->conduction == 0 ? 1 : -1, 0);
    s->limiting = limited(m, m->limiting, 1);
    s->limiting_back = limited(m, m->limiting_back, -1);
    s->command = lasting_switch(command != m->command ? -1 : command == UNHELD ? 1 : fabs(fabs(m->v) - m->dead_band), command);
}

static void enter(Variables *m)
{
    if (m->motion == 0) m->w = 0;
    if (m->limiting != 0 && !gives_way(m)) m->i = m->current_limit;
    if (m->limiting_back != 0 && !gives_way(m)) m->i = -m->current_limit;
    if (m->conduction == 0 || is_open(m)) m->i = 0;
}
