/* recursions: of signals, and of a motor's two states, row by row. Included by kalman.c, which has EXPORT. */
#ifndef RECURSIONS_H
#define RECURSIONS_H

/* The recursion of one signal of c, of which every c-th number is, with up to two numbers behind the first: all that it
   remembers is kept at hand, so that y may be x. */
static void recur_one(int64_t n, int64_t c, int64_t ahead, int64_t back, const double *b, const double *a,
                      const double *x, double *y)
{
    const double b0 = ahead > 0 ? b[0] : 0.0, b1 = ahead > 1 ? b[c] : 0.0, b2 = ahead > 2 ? b[2 * c] : 0.0;
    const double a0 = back > 0 ? a[0] : 0.0, a1 = back > 1 ? a[c] : 0.0;
    double last = 0.0, before = 0.0, x1 = 0.0, x2 = 0.0;
    for (int64_t j = 0; j < n; j++) {
        double now = b0 * x[j * c] + b1 * x1 + b2 * x2 - a0 * last;
        if (back > 1) now -= a1 * before; /* what each number waits for */
        x2 = x1;
        x1 = x[j * c];
        before = last;
        y[j * c] = last = now;
    }
}

/* Set y, (n, c), to the recursions y[j] = b[0] x[j] + b[1] x[j - 1] ... - a[0] y[j - 1] - a[1] y[j - 2] ..., all 0
   before; b: (ahead, c), a: (back, c). */
EXPORT void recursion_run(int64_t n, int64_t c, int64_t ahead, int64_t back, const double *restrict b,
                          const double *restrict a, const double *x, double *y)
{
#if defined(__SSE2__)
    const unsigned control = _mm_getcsr();
    _mm_setcsr(control | FLUSH_TO_ZERO);
#endif
    if (c < 4 && ahead <= 3 && back <= 2) {
        for (int64_t k = 0; k < c; k++) recur_one(n, c, ahead, back, b + k, a + k, x + k, y + k);
    } else {
        for (int64_t j = 0; j < n; j++) {
            double *restrict to = y + j * c;
            for (int64_t k = 0; k < c; k++) to[k] = 0.0;
            for (int64_t l = 0; l < ahead && l <= j; l++)
                for (int64_t k = 0; k < c; k++) to[k] += b[l * c + k] * x[(j - l) * c + k];
            for (int64_t l = 0; l < back && l < j; l++)
                for (int64_t k = 0; k < c; k++) to[k] -= a[l * c + k] * y[(j - 1 - l) * c + k];
        }
    }
#if defined(__SSE2__)
    _mm_setcsr(control);
#endif
}

/* Set y, (n), numbers `apart` from each other, to what a filter shows of a signal with the last of each row's numbers,
   x, (n, c), `along` and `across` apart. It is sections of gain 1, (sections, 5), b0 b1 b2 a0 a1 each as above, which were
   at rest at their first number. y may be x. */
EXPORT void sections_run(int64_t n, int64_t c, int64_t sections, const double *given, const double *x, int64_t along,
                         int64_t across, double *y, int64_t apart)
{
    double level[2] = {0}, x1[2] = {0}, x2[2] = {0}, last[2] = {0}, before[2] = {0};
#if defined(__SSE2__)
    const unsigned control = _mm_getcsr();
    _mm_setcsr(control | FLUSH_TO_ZERO);
#endif
    for (int64_t j = 0; j < n; j++) {
        double shown = 0.0;
        for (int64_t k = 0; k < c; k++) {
            shown = x[j * along + k * across];
            for (int64_t s = 0; s < sections; s++) {
                const double *f = given + 5 * s;
                if (j == 0 && k == 0) level[s] = shown;
                const double own = shown - level[s];
                double now = f[0] * own + f[1] * x1[s] + f[2] * x2[s] - f[3] * last[s];
                now -= f[4] * before[s];
                x2[s] = x1[s];
                x1[s] = own;
                before[s] = last[s];
                last[s] = now;
                shown = now + level[s];
            }
        }
        y[j * apart] = shown;
    }
#if defined(__SSE2__)
    _mm_setcsr(control);
#endif
}

/* States of a motor, current, speed and angle, x[0] = start, 0, and x[j + 1] = F x[j] + G u[j], of c inputs each, (n, c)
   voltages and torques, NULL: none of these; where the circuit is open, 1, there is no current, and the speed w[j + 1] =
   coasting[0] w[j] + coasting[1] torque[j], which turns the angle by coasting[2] and coasting[3] of both; 2: it is within
   the row, at whose instant a current still flows. Set shown, (n, q, c), to what q seats name: a state, or 3, the mean of
   the speed since the row before, over a step; 0 in the first. start: (2, c); f: (3, 2); g: (3, 2). */
EXPORT void response_run(int64_t n, int64_t q, int64_t c, double step, const double *f, const double *g,
                         const double *coasting, const unsigned char *open, const double *voltage, const double *torque,
                         const double *start, const int64_t *seats, double *shown)
{
#if defined(__SSE2__)
    const unsigned control = _mm_getcsr();
    _mm_setcsr(control | FLUSH_TO_ZERO);
#endif
    for (int64_t l = 0; l < c; l++) {
        double x[4] = {start[l], start[c + l], 0.0, 0.0};
        for (int64_t j = 0; j < n; j++) {
            const double v = voltage ? voltage[j * c + l] : 0.0, t = torque ? torque[j * c + l] : 0.0;
            if (open[j] == 1) x[0] = 0.0;
            for (int64_t k = 0; k < q; k++) shown[(j * q + k) * c + l] = x[seats[k]];
            const double i = open[j] ? 0.0 : f[0] * x[0] + f[1] * x[1] + (g[0] * v + g[1] * t);
            const double turned = open[j] ? coasting[2] * x[1] + coasting[3] * t
                                          : f[4] * x[0] + f[5] * x[1] + (g[4] * v + g[5] * t);
            x[1] = open[j] ? coasting[0] * x[1] + coasting[1] * t : f[2] * x[0] + f[3] * x[1] + (g[2] * v + g[3] * t);
            x[0] = i;
            x[2] += turned;
            x[3] = turned / step;
        }
    }
#if defined(__SSE2__)
    _mm_setcsr(control);
#endif
}

#endif
