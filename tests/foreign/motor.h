/* A DC motor as another tool would write it: names of its own, Ke and Km apart, RK4 inside. No code of fmu_build.
 *
 *     La di/dt = u - Ra i - Ke w          Jm dw/dt = Km i - c w - Tc sign(w) friction
 *
 * What it does wrong is chosen by defining, before inclusion:
 *     EULER              one Euler step a communication step
 *     SHARED             all instances share one struct
 *     IDLE_RESET         reset does nothing;  CRASHING_RESET, FAILING_RESET
 *     NO_EXTRAS          what it does not offer is missing in the library (FMI 2.0)
 *     NO_TOOL            there is never an instance
 *     HANGING_FREE       freeInstance never returns
 *     ONCE               a second instance in one process gets NULL, ever
 *     OWN_STEP           doStep advances by 1 ms, whatever is asked
 *     ONLY_STEP          doStep of anything but 1 ms is an error
 *     STOPS_AT           doStep past that time is discarded, whatever it was told
 *     OWN_STOP           doStep past that time is discarded, unless it was told another stop time
 *     FORGETS_AT_SETUP   what is set before the experiment is set up is forgotten
 *     STARTS_AT          it begins at that time and no other; each step must begin where the one before ended
 *     SELF_DRIVEN        no input: 10.5 V from 0.1 s on
 *     INTERPOLATES       it takes the slope of its voltage
 *     DEGREES            it shows its speed in degrees a second
 *     LATE_IGNORED       parameters set after initialisation are accepted and ignored
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { RA, LA, KE, KM, JM, FRICTION, U, SPEED, CURRENT, POWER, COUNT };
enum { MODE, ENABLED };

typedef struct {
    double values[COUNT];
    int mode;      /* 0: no friction, 1: viscous */
    int enabled;
    double time;
    int initialised;
    int stops;     /* it was told a stop time */
    double stop;
    const void *callbacks;
    double slope;  /* of the voltage, since the begin of the step */
    double since;
} Motor;

static const double START[COUNT] = {3.0, 0.012, 0.05, 0.05, 1e-5, 1.5e-4, 0, 0, 0, 0};

static void start(Motor *m) {
    memcpy(m->values, START, sizeof START);
    m->mode = 1;
    m->enabled = 1;
    m->time = 0;
    m->initialised = m->stops = 0;
}

#ifdef SHARED
static Motor shared;
static int used;
#endif
#ifdef ONCE
static int instances;
#endif

static Motor *create(void) {
#ifdef NO_TOOL
    return NULL;
#endif
#ifdef ONCE
    if (instances++ > 0) return NULL;
#endif
#ifdef SHARED
    if (!used++) start(&shared); /* and never again */
    return &shared;
#else
    Motor *m = calloc(1, sizeof *m);
    if (m != NULL) start(m);
    return m;
#endif
}

static void destroy(Motor *m) {
#ifdef HANGING_FREE
    for (;;) {}
#endif
#ifndef SHARED
    free(m);
#else
    (void)m;
#endif
}

/* What it is told before initialisation; 0: it refuses. */
static int set_up(Motor *m, double from, int stops, double stop) {
#ifdef FORGETS_AT_SETUP
    memcpy(m->values, START, sizeof START);
#endif
    m->time = from;
    m->stops = stops;
    m->stop = stop;
#ifdef STARTS_AT
    if (from != STARTS_AT) return 0;
#endif
    return !stops || stop > from;
}

static double voltage(const Motor *m, double time) {
#ifdef SELF_DRIVEN
    (void)m;
    return time > 0.1 - 1e-9 ? 10.5 : 0.0;
#else
    (void)time;
    return m->enabled ? m->values[U] + m->slope * m->since : 0.0;
#endif
}

static void derivatives(const Motor *m, const double x[2], double time, double d[2]) {
    const double *p = m->values;
    d[0] = (voltage(m, time) - p[RA] * x[0] - p[KE] * x[1]) / p[LA];
    d[1] = (p[KM] * x[0] - (m->mode ? p[FRICTION] : 0.0) * x[1]) / p[JM];
}

static int advance(Motor *m, double time, double h) {
    double *x = m->values, s[2] = {x[CURRENT], x[SPEED]};
    int n = 40;
#ifdef OWN_STEP
    h = 1e-3;
#endif
#ifdef ONLY_STEP
    if (fabs(h - 1e-3) > 1e-9) return 0;
#endif
#ifdef STOPS_AT
    if (time + h > STOPS_AT + 1e-9) return 0;
#endif
#ifdef OWN_STOP
    if (time + h > (m->stops ? m->stop : OWN_STOP) + 1e-9) return 0;
#endif
#ifdef STARTS_AT
    if (fabs(time - m->time) > 1e-9) return 0;
#endif
#ifdef EULER
    n = 1;
#endif
    h /= n;
    for (int k = 0; k < n; k++) {
        double a[2], b[2], c[2], d[2], y[2];
        m->since = k * h;
        derivatives(m, s, time, a);
#ifdef EULER
        s[0] += h * a[0], s[1] += h * a[1];
        (void)b, (void)c, (void)d, (void)y;
#else
        m->since = (k + 0.5) * h;
        y[0] = s[0] + h / 2 * a[0], y[1] = s[1] + h / 2 * a[1];
        derivatives(m, y, time, b);
        y[0] = s[0] + h / 2 * b[0], y[1] = s[1] + h / 2 * b[1];
        derivatives(m, y, time, c);
        m->since = (k + 1) * h;
        y[0] = s[0] + h * c[0], y[1] = s[1] + h * c[1];
        derivatives(m, y, time, d);
        s[0] += h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0]);
        s[1] += h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1]);
#endif
    }
    x[CURRENT] = s[0], x[SPEED] = s[1];
    m->time = time + h * n;
    return 1;
}

/* What is shown and taken may be in other units: rpm, mA, mH; degrees. */
static double shown(const Motor *m, unsigned reference) {
    double value = reference == POWER ? m->values[U] * m->values[CURRENT] : m->values[reference];
#ifdef REVERSED
    if (reference == CURRENT) value = -value;
#endif
#ifdef DEGREES
    if (reference == SPEED) value *= 180 / 3.14159265358979323846;
#endif
#ifdef WORKSHOP_UNITS
    if (reference == SPEED) value *= 30 / 3.14159265358979323846;
    if (reference == CURRENT || reference == LA) value *= 1e3;
    if (reference == JM) value *= 1e7;
#endif
    return value;
}

static void take(Motor *m, unsigned reference, double value) {
#ifdef WORKSHOP_UNITS
    if (reference == SPEED) value /= 30 / 3.14159265358979323846;
    if (reference == CURRENT || reference == LA) value /= 1e3;
    if (reference == JM) value /= 1e7;
#endif
#ifdef LATE_IGNORED
    if (reference < U && m->initialised) return;
#endif
    m->values[reference] = value;
}
