/* A DC motor on a supply, on a fine grid, for benchmarks/emulated_bench.py. Shares nothing with the estimator or its FMUs.

       L di/dt = v - d - (R (1 + heat q) + Rs) i - K w - Vb tanh(i / ib)      d: sag of a supply with a capacitor
       J dw/dt = K i - f(t) (B w + F(w)),   F = sign(w) (Tc + (Ts - Tc) exp(-|w| / ws))
       ts dd/dt = Rsag i - d,   dq/dt = i^2

   Exact matrix exponential of the equations linearised at the start of every step (the motor is linear: exact), split at
   every switch of the voltage and, by bisection, where the speed changes its sign, the rotor breaks away, the
   current reaches the supply's limit or leaves it. A rotor at rest stays there while |K i| <= f Ts. */
#include <math.h>

enum { NORMAL, LIMIT, OPEN };

typedef struct {
    double R, K, L, J, B, Tc, Ts, ws, Vb, ib, limit, Rs, Rsag, ts, heat;
} Motor;

typedef struct {
    double i, w, angle, drop, q;
    int electric, sign; /* sign: of the motion; 0: stuck */
} State;

static double resistance(const Motor *m, const State *s) { return m->R * (1.0 + m->heat * s->q) + m->Rs; }

/* x' = a x + b for a time h */
static double first_order(double x, double a, double b, double h) {
    double z = a * h;
    return x + (a * x + b) * (fabs(z) < 1e-12 ? h : expm1(z) / a);
}

static State advance(const Motor *m, State s, double v, double f, double h) {
    State n = s;
    double e = exp(-fabs(s.w) / m->ws), slope = -f * (m->Ts - m->Tc) / m->ws * e;
    double friction = f * s.sign * (m->Tc + (m->Ts - m->Tc) * e) - slope * s.w, B = f * m->B + slope;
    double th = tanh(s.i / m->ib), rb = m->Vb / m->ib * (1.0 - th * th);
    double drop = s.drop;
    if (m->ts > 0.0) drop = first_order(s.drop, -1.0 / m->ts, m->Rsag * s.i / m->ts, 0.5 * h);
    double R = resistance(m, &s) + rb, u = v - drop - (m->Vb * th - rb * s.i);
    int moving = s.sign != 0 || m->Ts == 0.0;
    double w1 = (m->K * s.i - B * s.w - friction) / m->J; /* acceleration at the start */
    if (s.electric == NORMAL && moving) {
        double a = -R / m->L, b = -m->K / m->L, c = m->K / m->J, d = -B / m->J;
        double p = a * s.i + b * s.w + u / m->L, r = c * s.i + d * s.w - friction / m->J; /* derivative */
        double mean = 0.5 * (a + d), g = 0.25 * (a - d) * (a - d) + b * c, k = sqrt(fabs(g)), ch, sh;
        if (k * h < 1e-6) { ch = 1.0 + 0.5 * g * h * h; sh = h * (1.0 + g * h * h / 6.0); }
        else if (g > 0.0) { ch = cosh(k * h); sh = sinh(k * h) / k; }
        else { ch = cos(k * h); sh = sin(k * h) / k; }
        double x = exp(mean * h);                            /* exp(A h) = x (ch + sh (A - mean)) */
        double e11 = x * (ch + sh * (a - mean)) - 1.0, e12 = x * sh * b, e21 = x * sh * c, e22 = x * (ch + sh * (d - mean)) - 1.0;
        double det = a * d - b * c, y1 = e11 * p + e12 * r, y2 = e21 * p + e22 * r; /* A^-1 (exp(A h) - 1) x' */
        n.i = s.i + (d * y1 - b * y2) / det;
        n.w = s.w + (-c * y1 + a * y2) / det;
    } else {
        if (s.electric == NORMAL) n.i = first_order(s.i, -R / m->L, u / m->L, h);
        if (moving) n.w = first_order(s.w, -B / m->J, (m->K * s.i - friction) / m->J, h);
    }
    double w2 = (m->K * n.i - B * n.w - friction) / m->J;
    if (moving) n.angle += 0.5 * h * (s.w + n.w) + h * h / 12.0 * (w1 - w2);
    if (m->ts > 0.0) n.drop = first_order(drop, -1.0 / m->ts, m->Rsag * n.i / m->ts, 0.5 * h);
    n.q += h * (s.i * s.i + s.i * n.i + n.i * n.i) / 3.0;
    return n;
}

/* Negative where the state has left its mode: 1 the motion, 2 the current's limit */
static int left(const Motor *m, const State *s, double v, double f) {
    if (m->Ts > 0.0 && (s->sign ? s->sign * s->w < 0.0 : fabs(m->K * s->i) > f * m->Ts)) return 1;
    if (s->electric == NORMAL && fabs(s->i) > m->limit) return 2;
    if (s->electric == LIMIT) {
        double push = v - s->drop - resistance(m, s) * s->i - m->K * s->w - m->Vb * tanh(s->i / m->ib);
        if (push * s->i < 0.0) return 2;
    }
    return 0;
}

static void change(const Motor *m, State *s, int what, double f) {
    if (what == 1) {
        s->w = 0.0;
        s->sign = fabs(m->K * s->i) > f * m->Ts ? (s->i > 0.0 ? 1 : -1) : 0;
    } else if (s->electric == LIMIT) {
        s->electric = NORMAL;
        s->i *= 1.0 - 1e-12;
    } else {
        s->electric = LIMIT;
        s->i = copysign(m->limit, s->i);
    }
}

/* out: 5 values a grid point: current, speed, angle, terminal voltage just after the point, heat. Returns changes of mode. */
int simulate(const Motor *m, int segments, const double *from, const double *volts, const int *open, int n, double dt,
             const double *factor, double speed, double *out) {
    State s = {0.0, speed, 0.0, 0.0, 0.0, NORMAL, 0};
    int k = 0, changes = 0;
    s.i = open[0] || speed == 0.0 ? 0.0 : (volts[0] - m->K * speed) / (m->R + m->Rs);
    s.sign = (speed > 0.0) - (speed < 0.0);
    for (int j = 0; j < n; ++j) {
        double t = j * dt, end = (j + 1) * dt, f = factor[j];
        double *row = out + 5 * j;
        row[0] = s.i, row[1] = s.w, row[2] = s.angle, row[4] = s.q;
        for (int first = 1, guard = 0; t < end; first = 0) {
            while (k + 1 < segments && from[k + 1] <= t + 1e-9 * dt) ++k;
            if (open[k]) { s.electric = OPEN; s.i = 0.0; }
            else if (s.electric == OPEN) s.electric = NORMAL;
            if (first)
                row[3] = open[k]                  ? m->K * s.w
                         : s.electric == LIMIT ? resistance(m, &s) * s.i + m->K * s.w
                                               : volts[k] - s.drop - m->Rs * s.i;
            double h = end - t;
            if (k + 1 < segments && from[k + 1] < end) h = from[k + 1] - t;
            int what = left(m, &s, volts[k], f);
            if (what && guard++ < 8) { change(m, &s, what, f); ++changes; continue; }
            State next = advance(m, s, volts[k], f, h);
            if (guard < 8 && left(m, &next, volts[k], f)) {
                double low = 0.0, high = h;
                for (int b = 0; b < 45; ++b) {
                    double middle = 0.5 * (low + high);
                    State trial = advance(m, s, volts[k], f, middle);
                    if (left(m, &trial, volts[k], f)) high = middle; else low = middle;
                }
                h = high;
                next = advance(m, s, volts[k], f, h);
            }
            s = next;
            t += h;
            if (end - t < 1e-9 * dt) t = end;
        }
    }
    return changes;
}
