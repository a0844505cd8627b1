/* kalman: the exact whitening of linear Gaussian noise, column by column; recursions, those of a motor's
 * two states among them; products of long columns; small factors; the steps of fits; kept memory. Knows no FMU.
 *
 *     x_0 ~ N(0, initial)
 *     x_j = F x_(j-1) + N(0, Q)                 F, Q: of the time step that ends in row j
 *     y_j = H x_j + N(0, diag(variance_j))      a channel whose variance is infinite is missing in that row
 *
 * gives y the covariance S. The innovations of a Kalman filter, each over its standard deviation, are W y with
 * W' W = S^-1, W lower triangular; the logarithms of the innovations' variances add up to log det S. What is whitened
 * may be anything linear in y: residuals, columns of a Jacobian. All columns share the gains and go through together.
 *
 * The channels of a row are taken one by one, as their measurement noise is independent. A covariance that is updated
 * by P - K g', g = P H', loses its digits where P is much larger than the variance r. The exact result gives P H' = r K;
 * what is left of it, u = r K - P H', is put back on both sides, so that an error E becomes (1 - K H) E (1 - K H)'.
 *
 * Rows after rows of one variance and one time step: once the covariance has converged, gains and variances are kept
 * until either changes.
 */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#if defined(__GLIBC__)
#include <malloc.h>
#endif

#include "gauss_newton.h"
#include "trust_region.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#if defined(__SSE2__)
#include <xmmintrin.h>
#define FLUSH_TO_ZERO 0x8040u /* and denormals are zero: a mean that dies out must not become slow */
#endif

enum { FINISHED = 0, NO_MEMORY = 1 };

#define NEAR 1e-9     /* relative change of a variance from row to row, below which convergence is looked for */
#define STEADY 1e-12  /* relative change of the covariances still to come, at which they have converged */
#define STEADY_ROWS 4 /* in a row */

/* Matrices that are mostly zero, by rows: the entries of row i are those from start[i] to start[i + 1]. */
typedef struct {
    size_t *start, *at;
    double *value;
} Sparse;

typedef struct {
    size_t n, q, c, d; /* rows, channels, columns, states */
    Sparse transition; /* all k of them below each other */
    Sparse readout;
    const double *process, *variance, *columns;
    const int64_t *steps; /* NULL: always 0 */
} Noise;

typedef struct {
    double *P, *FP, *before;  /* covariance; F P; the covariance predicted a row before: d, d */
    double *gain, *spread;    /* of each channel: q, d and q, the innovation's variance */
    double *g, *u;            /* d */
    double *x, *next, *error; /* means: d, c, twice, and innovations: c */
} Memory;

static bool sparse_make(Sparse *m, const double *full, size_t rows, size_t columns)
{
    size_t entries = 0;
    m->start = malloc((rows + 1) * sizeof *m->start);
    m->at = malloc((rows * columns + 1) * sizeof *m->at);
    m->value = malloc((rows * columns + 1) * sizeof *m->value);
    if (!m->start || !m->at || !m->value) return false;
    for (size_t i = 0; i < rows; i++) {
        m->start[i] = entries;
        for (size_t j = 0; j < columns; j++) {
            if (full[i * columns + j] == 0) continue;
            m->at[entries] = j;
            m->value[entries++] = full[i * columns + j];
        }
    }
    m->start[rows] = entries;
    return true;
}

static void sparse_free(Sparse *m)
{
    free(m->start);
    free(m->at);
    free(m->value);
}

/* P = F P F' + Q */
static void predict_covariance(const Noise *noise, size_t kind, Memory *m)
{
    const Sparse *F = &noise->transition;
    const size_t d = noise->d, *start = F->start + kind * d;
    const double *Q = noise->process + kind * d * d;
    for (size_t i = 0; i < d; i++) {
        double *restrict row = m->FP + i * d;
        memset(row, 0, d * sizeof *row);
        for (size_t k = start[i]; k < start[i + 1]; k++) {
            const double *restrict from = m->P + F->at[k] * d;
            const double f = F->value[k];
            for (size_t j = 0; j < d; j++) row[j] += f * from[j];
        }
    }
    for (size_t i = 0; i < d; i++)
        for (size_t j = 0; j <= i; j++) {
            double sum = Q[i * d + j];
            for (size_t k = start[j]; k < start[j + 1]; k++) sum += m->FP[i * d + F->at[k]] * F->value[k];
            m->P[i * d + j] = m->P[j * d + i] = sum;
        }
}

/* The largest change of a covariance since the row before, over the deviations of its two states; 1 while not near. */
static double covariance_change(const double *P, const double *before, size_t d)
{
    double largest = 0;
    for (size_t i = 0; i < d; i++)
        if (fabs(P[i * d + i] - before[i * d + i]) > NEAR * P[i * d + i]) return 1;
    for (size_t i = 0; i < d; i++)
        for (size_t j = 0; j <= i; j++) {
            const double change = fabs(P[i * d + j] - before[i * d + j]);
            if (change > 0) largest = fmax(largest, change / sqrt(P[i * d + i] * P[j * d + j]));
        }
    return fmin(largest, 1);
}

/* One channel is measured with variance r: its gain, its innovation's variance, and P after it. */
static void update_covariance(const Noise *noise, size_t channel, double r, Memory *m)
{
    const Sparse *H = &noise->readout;
    const size_t d = noise->d, first = H->start[channel], last = H->start[channel + 1];
    double *restrict P = m->P, *restrict K = m->gain + channel * d, *restrict g = m->g, *restrict u = m->u;
    double spread = 0, uh = 0;
    memset(g, 0, d * sizeof *g);
    for (size_t k = first; k < last; k++)
        for (size_t j = 0; j < d; j++) g[j] += H->value[k] * P[H->at[k] * d + j];
    for (size_t k = first; k < last; k++) spread += H->value[k] * g[H->at[k]];
    m->spread[channel] = spread = (spread > 0 ? spread : 0) + r;
    for (size_t i = 0; i < d; i++) K[i] = g[i] / spread;
    for (size_t i = 0; i < d; i++)
        for (size_t j = 0; j <= i; j++) P[j * d + i] = P[i * d + j] -= K[i] * g[j];
    for (size_t i = 0; i < d; i++) u[i] = r * K[i];
    for (size_t k = first; k < last; k++)
        for (size_t i = 0; i < d; i++) u[i] -= H->value[k] * P[H->at[k] * d + i];
    for (size_t k = first; k < last; k++) uh += H->value[k] * u[H->at[k]];
    for (size_t i = 0; i < d; i++) {
        const double v = u[i] - uh * K[i];
        for (size_t j = 0; j <= i; j++) P[j * d + i] = P[i * d + j] += K[i] * u[j] + v * K[j];
        if (P[i * d + i] < 0) P[i * d + i] = 0;
    }
}

/* x = F x, all columns; c is noise->c, perhaps known when this is compiled. */
static inline void predict_means(const Noise *noise, size_t kind, Memory *m, size_t c)
{
    const Sparse *F = &noise->transition;
    const size_t d = noise->d, *start = F->start + kind * d;
    double *from = m->x;
    for (size_t i = 0; i < d; i++) {
        double *restrict to = m->next + i * c;
        for (size_t l = 0; l < c; l++) to[l] = 0;
        for (size_t k = start[i]; k < start[i + 1]; k++) {
            const double *restrict x = from + F->at[k] * c;
            const double f = F->value[k];
            for (size_t l = 0; l < c; l++) to[l] += f * x[l];
        }
    }
    m->x = m->next;
    m->next = from;
}

/* y's innovation, over its deviation, to w; x after it. */
static inline void update_means(const Noise *noise, size_t channel, const double *restrict y, double *restrict w,
                                Memory *m, size_t c)
{
    const Sparse *H = &noise->readout;
    const double *restrict K = m->gain + channel * noise->d;
    const double scale = 1 / sqrt(m->spread[channel]);
    double *restrict e = m->error;
    for (size_t l = 0; l < c; l++) e[l] = y[l];
    for (size_t k = H->start[channel]; k < H->start[channel + 1]; k++) {
        const double *restrict x = m->x + H->at[k] * c;
        const double h = H->value[k];
        for (size_t l = 0; l < c; l++) e[l] -= h * x[l];
    }
    for (size_t i = 0; i < noise->d; i++) {
        double *restrict x = m->x + i * c;
        for (size_t l = 0; l < c; l++) x[l] += K[i] * e[l];
    }
    for (size_t l = 0; l < c; l++) w[l] = e[l] * scale;
}

/* All rows; returns the sum of the logarithms of the innovations' variances. */
static inline double filter(const Noise *noise, Memory *m, double *whitened, size_t c)
{
    const size_t n = noise->n, q = noise->q, d = noise->d;
    double logarithms = 0, row_logarithms = 0, change = 1;
    int converging = 0;
    for (size_t j = 0; j < n; j++) {
        const double *r = noise->variance + j * q;
        const size_t kind = noise->steps ? (size_t)noise->steps[j] : 0;
        const bool alike = j > 1 && (!noise->steps || noise->steps[j] == noise->steps[j - 1]) &&
                           memcmp(r, r - q, q * sizeof *r) == 0;
        const bool steady = alike && converging >= STEADY_ROWS;
        if (j > 0) predict_means(noise, kind, m, c);
        if (!steady) {
            if (j > 0) predict_covariance(noise, kind, m);
            if (alike) {
                const double last = change;
                change = covariance_change(m->P, m->before, d);
                converging = change < STEADY * (1 - change / last) || change == 0 ? converging + 1 : 0;
            } else {
                change = 1;
                converging = 0;
            }
            memcpy(m->before, m->P, d * d * sizeof *m->P);
            row_logarithms = 0;
        }
        for (size_t i = 0; i < q; i++) {
            double *w = whitened + (j * q + i) * c;
            if (isinf(r[i])) {
                memset(w, 0, c * sizeof *w);
                continue;
            }
            if (!steady) {
                update_covariance(noise, i, r[i], m);
                row_logarithms += log(m->spread[i]);
            }
            update_means(noise, i, noise->columns + (j * q + i) * c, w, m, c);
        }
        logarithms += row_logarithms;
    }
    return logarithms;
}

/* The same of noise without a state: each sample over its deviation, whose root and logarithm are taken anew where a
   row's variances change. */
static double filter_white(const Noise *noise, Memory *m, double *whitened)
{
    const size_t n = noise->n, q = noise->q, c = noise->c;
    double logarithms = 0, row_logarithms = 0;
    for (size_t j = 0; j < n; j++) {
        const double *r = noise->variance + j * q;
        if (j == 0 || memcmp(r, r - q, q * sizeof *r) != 0) {
            row_logarithms = 0;
            for (size_t i = 0; i < q; i++) {
                m->spread[i] = isinf(r[i]) ? 0 : 1 / sqrt(r[i]);
                if (!isinf(r[i])) row_logarithms += log(r[i]);
            }
        }
        for (size_t i = 0; i < q; i++) {
            const double *restrict y = noise->columns + (j * q + i) * c;
            double *restrict w = whitened + (j * q + i) * c;
            const double scale = m->spread[i];
            if (scale == 0)
                memset(w, 0, c * sizeof *w);
            else
                for (size_t l = 0; l < c; l++) w[l] = y[l] * scale;
        }
        logarithms += row_logarithms;
    }
    return logarithms;
}

static double *taken(double **free_memory, size_t numbers)
{
    double *taken = *free_memory;
    *free_memory += numbers;
    return taken;
}

/* Whiten columns: (n, q, c). transition and process: (k, d, d); steps: (n) indices below k, or NULL; initial: (d, d);
   readout: (q, d); variance: (n, q). Sets whitened: (n, q, c), and the sum of the logarithms. */
EXPORT int64_t kalman_whiten(int64_t n, int64_t q, int64_t c, int64_t d, int64_t k, const double *transition,
                             const double *process, const double *initial, const double *readout, const int64_t *steps,
                             const double *variance, const double *columns, double *whitened, double *logarithms)
{
    Noise noise = {(size_t)n, (size_t)q, (size_t)c, (size_t)d, {0}, {0}, process, variance, columns, steps};
    const size_t dd = noise.d * noise.d, dc = noise.d * noise.c;
    double *memory = calloc(3 * dd + noise.q * (noise.d + 1) + 2 * noise.d + 2 * dc + noise.c + 1, sizeof *memory);
    const bool there = sparse_make(&noise.transition, transition, (size_t)k * noise.d, noise.d) &&
                       sparse_make(&noise.readout, readout, noise.q, noise.d);
    if (memory && there) {
        double *left = memory;
        Memory m = {.P = taken(&left, dd), .FP = taken(&left, dd), .before = taken(&left, dd),
                    .gain = taken(&left, noise.q * noise.d), .spread = taken(&left, noise.q),
                    .g = taken(&left, noise.d), .u = taken(&left, noise.d), .x = taken(&left, dc),
                    .next = taken(&left, dc), .error = taken(&left, noise.c)};
#if defined(__SSE2__)
        const unsigned control = _mm_getcsr();
        _mm_setcsr(control | FLUSH_TO_ZERO);
#endif
        memcpy(m.P, initial, dd * sizeof *initial);
        *logarithms = noise.d == 0   ? filter_white(&noise, &m, whitened)
                      : noise.c == 1 ? filter(&noise, &m, whitened, 1)
                                     : filter(&noise, &m, whitened, noise.c);
#if defined(__SSE2__)
        _mm_setcsr(control);
#endif
    }
    sparse_free(&noise.transition);
    sparse_free(&noise.readout);
    free(memory);
    return memory && there ? FINISHED : NO_MEMORY;
}

/* Take short autoregressions out of whitened columns, (n, q, c), in place, the last row first: of row j and channel i
   the sum of coefficient[l] times row j - 1 - l, then over the deviation. kind: (n) 0 or 1, which of both models of a
   channel holds in a row; order, deviation: (2, q); coefficients: (2, q, most); missing samples, (n, q), are zero. */
EXPORT void kalman_shorten(int64_t n, int64_t q, int64_t c, int64_t most, const int64_t *order,
                           const double *coefficients, const double *deviation, const unsigned char *kind,
                           const unsigned char *present, double *columns)
{
    for (int64_t j = n - 1; j >= 0; j--)
        for (int64_t i = 0; i < q; i++) {
            double *restrict y = columns + (j * q + i) * c;
            const int64_t own = kind[j] * q + i;
            if (!present[j * q + i]) {
                memset(y, 0, (size_t)c * sizeof *y);
                continue;
            }
            for (int64_t l = 0; l < order[own] && l < j; l++) {
                const double *restrict before = y - (l + 1) * q * c;
                const double a = coefficients[own * most + l];
                for (int64_t k = 0; k < c; k++) y[k] -= a * before[k];
            }
            for (int64_t k = 0; k < c; k++) y[k] /= deviation[own];
        }
}

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

/* States of a motor, current and speed, x[0] = start, x[j + 1] = F x[j] + G u[j], of c inputs each, (n, c) voltages and
   torques, NULL: none of these; where the circuit is open there is no current, and the speed w[j + 1] = coasting[0] w[j]
   + coasting[1] torque[j]. Set shown, (n, q, c), to those that q seats name, 0 or 1. start: (2, c); f, g: (2, 2). */
EXPORT void response_run(int64_t n, int64_t q, int64_t c, const double *f, const double *g, const double *coasting,
                         const unsigned char *open, const double *voltage, const double *torque, const double *start,
                         const int64_t *seats, double *shown)
{
#if defined(__SSE2__)
    const unsigned control = _mm_getcsr();
    _mm_setcsr(control | FLUSH_TO_ZERO);
#endif
    for (int64_t l = 0; l < c; l++) {
        double x[2] = {start[l], start[c + l]};
        for (int64_t j = 0; j < n; j++) {
            const double v = voltage ? voltage[j * c + l] : 0.0, t = torque ? torque[j * c + l] : 0.0;
            if (open[j]) x[0] = 0.0;
            for (int64_t k = 0; k < q; k++) shown[(j * q + k) * c + l] = x[seats[k]];
            const double i = open[j] ? 0.0 : f[0] * x[0] + f[1] * x[1] + (g[0] * v + g[1] * t);
            x[1] = open[j] ? coasting[0] * x[1] + coasting[1] * t : f[2] * x[0] + f[3] * x[1] + (g[2] * v + g[3] * t);
            x[0] = i;
        }
    }
#if defined(__SSE2__)
    _mm_setcsr(control);
#endif
}

/* Set upper triangles r, (k, m, m), to the factors of matrices of products, r' r = gram, (k, m, m), each; 0 where one of
   them, its diagonal scaled to 1, has an eigenvalue that is not above `least`, or is of no numbers. */
EXPORT int64_t gram_factors(int64_t k, int64_t m, double least, const double *gram, double *r)
{
    for (; k > 0; k--, gram += m * m, r += m * m)
        for (int64_t tried = 0; tried < 2; tried++) { /* what is less `least` along the diagonal is positive, too */
            const double diagonal = tried ? 1.0 : 1.0 - least;
            for (int64_t i = 0; i < m; i++)
                for (int64_t j = 0; j < m; j++) {
                    const double size = sqrt(gram[i * m + i]) * sqrt(gram[j * m + j]);
                    double left = i == j ? diagonal : gram[i * m + j] / size;
                    for (int64_t l = 0; l < i && j >= i; l++) left -= r[l * m + i] * r[l * m + j];
                    if (!(i == j ? left > 0 && size > 0 && size < INFINITY : fabs(left) < INFINITY)) return 0;
                    r[i * m + j] = j < i ? 0.0 : i == j ? sqrt(left) : left / r[i * m + i];
                }
            for (int64_t i = 0; tried && i < m; i++)
                for (int64_t j = i; j < m; j++) r[i * m + j] *= sqrt(gram[j * m + j]);
        }
    return 1;
}

/* A fit by trust_region.h and its numbers, in memory of the caller's. */
typedef struct {
    TrustRegion fit;
    double numbers[];
} OwnFit;

/* Bytes of memory that a fit of p parameters needs. */
EXPORT int64_t fit_bytes(int64_t p)
{
    return (int64_t)sizeof(OwnFit) + trust_region_numbers(p) * (int64_t)sizeof(double);
}

/* Write where the fit is asked, or has ended, and its cost there, to [p + 1]. */
static int64_t pointed(const OwnFit *own, int64_t asked, double *point)
{
    const TrustRegion *fit = &own->fit;
    memcpy(point, asked == ASKS_RESIDUALS ? fit->tried : fit->x, (size_t)fit->p * sizeof(double));
    point[fit->p] = fit->cost;
    return asked;
}

/* Begin a fit at the point; bounds, and the optimum that is known, or NULL, stay the caller's. Returns what is asked. */
EXPORT int64_t fit_begin(OwnFit *own, int64_t p, int64_t evaluations, double ftol, double xtol, const double *low,
                         const double *high, const double *known, double known_cost, double *point)
{
    own->fit = (TrustRegion){.p = p, .evaluations = evaluations, .ftol = ftol, .xtol = xtol, .low = low, .high = high,
                             .known = known, .known_cost = known_cost};
    return pointed(own, trust_region_begin(&own->fit, point, own->numbers), point);
}

/* Take the sum of squares of so many residuals at the point, and go on to the next. */
EXPORT int64_t fit_take_cost(OwnFit *own, double cost, int64_t count, double *point)
{
    return pointed(own, take_cost(&own->fit, cost, count), point);
}

/* The same of derivatives and residuals, as a triangle. */
EXPORT int64_t fit_take_slopes(OwnFit *own, const double *triangle, int64_t rows, double *point)
{
    return pointed(own, take_slopes(&own->fit, triangle, rows), point);
}

/* The same by gauss_newton.h. */
typedef struct {
    GaussNewton fit;
    double numbers[];
} OwnDescent;

/* Bytes of memory that it needs. */
EXPORT int64_t descent_bytes(int64_t f)
{
    return (int64_t)sizeof(OwnDescent) + gauss_newton_numbers(f) * (int64_t)sizeof(double);
}

/* Write what was tried, where it stands, the last step and its correction, [4][f], and [4]: the cost there, whether it
   has moved, whether derivatives are corrected, whether they are those that were simulated there. */
static int64_t stood(const OwnDescent *own, int64_t asked, double *point)
{
    const GaussNewton *fit = &own->fit;
    const double *rows[] = {fit->tried, fit->x, fit->dx, fit->bend};
    for (int64_t k = 0; k < 4; k++) memcpy(point + k * fit->f, rows[k], (size_t)fit->f * sizeof(double));
    point += 4 * fit->f;
    point[0] = fit->cost;
    point[1] = (double)fit->moved;
    point[2] = (double)fit->corrects;
    point[3] = (double)(fit->have && fit->simulated);
    return asked;
}

/* Begin where the point stands; all arrays but that stay the caller's. Returns what is asked. */
EXPORT int64_t descent_begin(OwnDescent *own, int64_t f, int64_t iterations, int64_t rounds, int64_t fine, int64_t told,
                             double tolerance, double limit, double least_part, double most_part,
                             const double *low, const double *high, const double *longest, const double *known, const double *bars, double known_cost,
                             double cost, int64_t have, double *point)
{
    own->fit = (GaussNewton){.f = f, .iterations = iterations, .rounds = rounds, .fine = fine, .told = told,
                             .tolerance = tolerance, .limit = limit, .least_part = least_part,
                             .most_part = most_part, .low = low, .high = high, .longest = longest,
                             .known = known, .bars = bars, .known_cost = known_cost};
    return stood(own, gauss_newton_begin(&own->fit, point + f, cost, have, own->numbers), point);
}

/* Take a, (f, f), and g, (f,), of the derivatives and a misfit; `bends`: of what bends beside the tried point. */
EXPORT int64_t descent_take_triangle(OwnDescent *own, const double *a, const double *g, int64_t bends, double *point)
{
    return stood(own, take_triangle(&own->fit, a, g, bends != 0), point);
}

/* Take the cost at the tried point, and go on. */
EXPORT int64_t descent_take_cost(OwnDescent *own, double cost, double *point)
{
    return stood(own, take_tried(&own->fit, cost), point);
}

#define ROUNDING 1e-12 /* of a column's largest rows: less is none of it */

enum { CHUNK = 512, LANES = 8 }; /* rows that stay in the nearest cache; sums that do not wait for each other */

/* A column of many rows, of which every `stride`-th number is. */
typedef struct {
    const double *first;
    int64_t stride;
} Column;

/* Set `to` to m rows of a column from row j, times their factors; or to what they are more than another's, which a
   factor of 0 leaves out, whatever the number is. */
static void scaled_rows(Column column, const double *before, const double *factors, int64_t j, size_t m,
                        double *restrict to)
{
    const double *restrict from = column.first + j * column.stride, *restrict f = factors + j;
    const size_t stride = (size_t)column.stride;
    if (before) {
        const double *restrict less = before + j;
        for (size_t l = 0; l < m; l++) to[l] = f[l] == 0 ? 0 : (from[l * stride] - less[l]) * f[l];
    } else if (stride == 1) {
        for (size_t l = 0; l < m; l++) to[l] = from[l] * f[l];
    } else {
        for (size_t l = 0; l < m; l++) to[l] = from[l * stride] * f[l];
    }
}

static double product(const double *restrict a, const double *restrict b, size_t m)
{
    double sums[LANES] = {0};
    size_t l = 0;
    for (; l + LANES <= m; l += LANES)
        for (size_t k = 0; k < LANES; k++) sums[k] += a[l + k] * b[l + k];
    for (; l < m; l++) sums[0] += a[l] * b[l];
    return ((sums[0] + sums[1]) + (sums[2] + sums[3])) + ((sums[4] + sums[5]) + (sums[6] + sums[7]));
}

/* Set `to`, (n), to a column, or its change, each row times its factor. */
EXPORT void scaled_column(int64_t n, const double *factors, const double *column, int64_t stride, const double *before,
                          double *to)
{
    scaled_rows((Column){column, stride}, before, factors, 0, (size_t)n, to);
}

/* Set found, (c, c), to the products of columns of n rows, each row times its factor. The room holds c CHUNK numbers. */
EXPORT void scaled_gram(int64_t n, const double *factors, int64_t c, const double *const *columns,
                        const int64_t *strides, double *room, double *found)
{
    memset(found, 0, (size_t)(c * c) * sizeof *found);
    for (int64_t j = 0; j < n; j += CHUNK) {
        const size_t m = (size_t)(n - j < CHUNK ? n - j : CHUNK);
        if (product(factors + j, factors + j, m) == 0) continue;
        for (int64_t k = 0; k < c; k++) {
            double *own = room + k * CHUNK;
            scaled_rows((Column){columns[k], strides[k]}, NULL, factors, j, m, own);
            for (int64_t l = 0; l <= k; l++) found[k * c + l] += product(own, room + l * CHUNK, m);
        }
    }
    for (int64_t k = 0; k < c; k++)
        for (int64_t l = 0; l < k; l++) found[l * c + k] = found[k * c + l];
}

/* Of one column, less another if that is not NULL, of n rows, each row times its factor: set found, (c + 2), to the
   products with c columns, times the same factors, with `left`, (n), as it is, and with itself. Where it has settled, but
   for rounding, nothing else is read. */
EXPORT void scaled_products(int64_t n, const double *factors, const double *column, int64_t stride,
                            const double *before, const double *left, int64_t c, const double *const *columns,
                            const int64_t *strides, double *found)
{
    double own[CHUNK], twice[CHUNK], room[CHUNK], most = 0;
    memset(found, 0, (size_t)(c + 2) * sizeof *found);
    for (int64_t j = 0; j < n; j += CHUNK) {
        const size_t m = (size_t)(n - j < CHUNK ? n - j : CHUNK);
        scaled_rows((Column){column, stride}, before, factors, j, m, own);
        const double power = product(own, own, m);
        most = fmax(most, power);
        found[c + 1] += power;
        if (power <= ROUNDING * ROUNDING * most) continue;
        for (size_t l = 0; l < m; l++) twice[l] = own[l] * factors[j + (int64_t)l];
        for (int64_t k = 0; k < c; k++) {
            const double *other = columns[k] + j;
            if (strides[k] != 1) {
                other = room;
                for (size_t l = 0; l < m; l++) room[l] = columns[k][(j + (int64_t)l) * strides[k]];
            }
            found[k] += product(twice, other, m);
        }
        found[c] += product(own, left + j, m);
    }
}

/* Keep freed blocks up to a size, and free memory up to another, in bytes, for this process: glibc alone is asked. */
EXPORT void memory_keep(int largest, int most)
{
#if defined(__GLIBC__)
    mallopt(M_MMAP_THRESHOLD, largest);
    mallopt(M_TRIM_THRESHOLD, most);
#else
    (void)largest;
    (void)most;
#endif
}
