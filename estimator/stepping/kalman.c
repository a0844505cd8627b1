/* kalman: the exact whitening of linear Gaussian noise, column by column; factors of small matrices; kept memory.
 * Knows no FMU. What else the program does over all rows, or in steps, is in the headers that are included at the end.
 *
 *     x_0 ~ N(0, initial)
 *     x_j = F x_(j-1) + N(0, Q)                 F, Q: of the time step that ends in row j
 *     y_j = H x_j + N(0, diag(variance_j))      a channel whose variance is infinite is missing in that row
 *
 * gives y the covariance S. The innovations of a Kalman filter, each over its standard deviation, are W y with
 * W' W = S^-1, W lower triangular; the logarithms of the innovations' variances add up to log det S. What is whitened
 * may be anything linear in y: residuals, columns of a Jacobian. All columns share the gains, which are found first and
 * once for a noise, and go through together.
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

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#if defined(__SSE2__)
#include <xmmintrin.h>
#define FLUSH_TO_ZERO 0x8040u /* and denormals are zero: a mean that dies out must not become slow */
#endif

#if defined(__GNUC__)
#define ALWAYS inline __attribute__((always_inline)) /* into each of those that know its sizes */
#else
#define ALWAYS inline
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
    size_t q, d;       /* channels, states */
    Sparse transition; /* all k of them below each other */
    Sparse readout;
    const double *process, *variance;
    const int64_t *steps; /* NULL: always 0 */
} Noise;

/* The covariance, and how it goes on from row to row. */
typedef struct {
    double *P, *FP, *before;   /* covariance; F P; the covariance predicted a row before: d, d */
    double *g, *u;             /* d */
    double change, logarithms; /* of the row before */
    int converging;            /* rows in which it has changed no more */
} Covariance;

typedef struct {
    double *x, *next, *error; /* means: d, c, twice, and innovations: c */
} Means;

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

static void noise_free(Noise *noise, double *memory)
{
    sparse_free(&noise->transition);
    sparse_free(&noise->readout);
    free(memory);
}

/* P = F P F' + Q; d is noise->d here and below, known when this is compiled if it is small. */
static ALWAYS void predict_covariance(const Noise *noise, size_t kind, Covariance *m, size_t d)
{
    const Sparse *F = &noise->transition;
    const size_t *start = F->start + kind * d;
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
static ALWAYS double covariance_change(const double *P, const double *before, size_t d)
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

/* One channel is measured with variance r: its gain K, P after it. Returns its innovation's variance. */
static ALWAYS double update_covariance(const Noise *noise, size_t channel, double r, Covariance *m, double *restrict K,
                                       size_t d)
{
    const Sparse *H = &noise->readout;
    const size_t first = H->start[channel], last = H->start[channel + 1];
    double *restrict P = m->P, *restrict g = m->g, *restrict u = m->u;
    double spread = 0, uh = 0;
    memset(g, 0, d * sizeof *g);
    for (size_t k = first; k < last; k++)
        for (size_t j = 0; j < d; j++) g[j] += H->value[k] * P[H->at[k] * d + j];
    for (size_t k = first; k < last; k++) spread += H->value[k] * g[H->at[k]];
    spread = (spread > 0 ? spread : 0) + r;
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
    return spread;
}

/* Gains of n rows, (n, q, d), and one over the innovations' deviations, (n, q), 0 where a sample is missing; returns the
   sum of the logarithms of their variances. */
static ALWAYS double gains(const Noise *noise, Covariance *m, size_t n, double *gain, double *scale, size_t d)
{
    const size_t q = noise->q;
    double logarithms = 0;
    for (size_t j = 0; j < n; j++, gain += q * d, scale += q) {
        const double *r = noise->variance + j * q;
        const size_t kind = noise->steps ? (size_t)noise->steps[j] : 0;
        const bool alike = j > 1 && (!noise->steps || noise->steps[j] == noise->steps[j - 1]) &&
                           memcmp(r, r - q, q * sizeof *r) == 0;
        if (alike && m->converging >= STEADY_ROWS) {
            memcpy(gain, gain - q * d, q * d * sizeof *gain);
            memcpy(scale, scale - q, q * sizeof *scale);
            logarithms += m->logarithms;
            continue;
        }
        if (j > 0) predict_covariance(noise, kind, m, d);
        if (alike) {
            const double last = m->change;
            m->change = covariance_change(m->P, m->before, d);
            m->converging =
                m->change < STEADY * (1 - m->change / last) || m->change == 0 ? m->converging + 1 : 0;
        } else {
            m->change = 1;
            m->converging = 0;
        }
        memcpy(m->before, m->P, d * d * sizeof *m->P);
        m->logarithms = 0;
        for (size_t i = 0; i < q; i++) {
            if (isinf(r[i])) {
                memset(gain + i * d, 0, d * sizeof *gain);
                scale[i] = 0;
                continue;
            }
            const double spread = update_covariance(noise, i, r[i], m, gain + i * d, d);
            m->logarithms += log(spread);
            scale[i] = 1 / sqrt(spread);
        }
        logarithms += m->logarithms;
    }
    return logarithms;
}

static double gains_of(const Noise *noise, Covariance *m, size_t n, double *gain, double *scale)
{
    switch (noise->d) {
    case 1: return gains(noise, m, n, gain, scale, 1);
    case 2: return gains(noise, m, n, gain, scale, 2);
    case 3: return gains(noise, m, n, gain, scale, 3);
    case 4: return gains(noise, m, n, gain, scale, 4);
    case 5: return gains(noise, m, n, gain, scale, 5);
    case 6: return gains(noise, m, n, gain, scale, 6);
    case 7: return gains(noise, m, n, gain, scale, 7);
    default: return gains(noise, m, n, gain, scale, noise->d);
    }
}

/* n rows of c columns whitened by their gains, each sample over its size first, if sizes are given; c perhaps known
   when this is compiled. */
static ALWAYS void innovations(const Noise *noise, Means *m, size_t n, const double *gain, const double *scale,
                               const double *size, const double *columns, double *whitened, size_t c)
{
    const Sparse *F = &noise->transition, *H = &noise->readout;
    const size_t q = noise->q, d = noise->d;
    double *restrict e = m->error;
    for (size_t j = 0; j < n; j++) {
        const size_t *start = F->start + (noise->steps && j > 0 ? (size_t)noise->steps[j] : 0) * d;
        double *from = m->x;
        for (size_t i = 0; i < d && j > 0; i++) { /* x = F x */
            double *restrict to = m->next + i * c;
            for (size_t l = 0; l < c; l++) to[l] = 0;
            for (size_t k = start[i]; k < start[i + 1]; k++) {
                const double *restrict x = from + F->at[k] * c;
                const double f = F->value[k];
                for (size_t l = 0; l < c; l++) to[l] += f * x[l];
            }
        }
        if (j > 0) {
            m->x = m->next;
            m->next = from;
        }
        for (size_t at = j * q; at < (j + 1) * q; at++) {
            const double *restrict y = columns + at * c, *restrict K = gain + at * d;
            double *restrict w = whitened + at * c;
            if (scale[at] == 0) {
                memset(w, 0, c * sizeof *w);
                continue;
            }
            for (size_t l = 0; l < c; l++) e[l] = size ? y[l] / size[at] : y[l];
            for (size_t k = H->start[at - j * q]; k < H->start[at - j * q + 1]; k++) {
                const double *restrict x = m->x + H->at[k] * c;
                const double h = H->value[k];
                for (size_t l = 0; l < c; l++) e[l] -= h * x[l];
            }
            for (size_t s = 0; s < d; s++) { /* x = x + K e */
                double *restrict x = m->x + s * c;
                for (size_t l = 0; l < c; l++) x[l] += K[s] * e[l];
            }
            for (size_t l = 0; l < c; l++) w[l] = e[l] * scale[at];
        }
    }
}

/* A mean that dies out must not become slow: denormal numbers are zero until the control is given back. */
static unsigned flush_to_zero(void)
{
#if defined(__SSE2__)
    const unsigned control = _mm_getcsr();
    _mm_setcsr(control | FLUSH_TO_ZERO);
    return control;
#else
    return 0;
#endif
}

static void give_back_control(unsigned control)
{
#if defined(__SSE2__)
    _mm_setcsr(control);
#else
    (void)control;
#endif
}

static double *taken(double **free_memory, size_t numbers)
{
    double *taken = *free_memory;
    *free_memory += numbers;
    return taken;
}

/* Gains of a Kalman filter over n rows. transition and process: (k, d, d); initial: (d, d); readout: (q, d); steps: (n)
   indices below k, or NULL; variance: (n, q). Sets gain: (n, q, d), scale: (n, q), and the sum of the logarithms. */
EXPORT int64_t kalman_gains(int64_t n, int64_t q, int64_t d, int64_t k, const double *transition,
                            const double *process, const double *initial, const double *readout, const int64_t *steps,
                            const double *variance, double *gain, double *scale, double *logarithms)
{
    Noise noise = {(size_t)q, (size_t)d, {0}, {0}, process, variance, steps};
    const size_t dd = noise.d * noise.d;
    double *memory = calloc(3 * dd + 2 * noise.d + 1, sizeof *memory), *left = memory;
    const bool there = sparse_make(&noise.transition, transition, (size_t)k * noise.d, noise.d) &&
                       sparse_make(&noise.readout, readout, noise.q, noise.d) && memory;
    if (there) {
        Covariance m = {.P = taken(&left, dd), .FP = taken(&left, dd), .before = taken(&left, dd),
                        .g = taken(&left, noise.d), .u = taken(&left, noise.d), .change = 1};
        const unsigned control = flush_to_zero();
        memcpy(m.P, initial, dd * sizeof *initial);
        *logarithms = gains_of(&noise, &m, (size_t)n, gain, scale);
        give_back_control(control);
    }
    noise_free(&noise, memory);
    return there ? FINISHED : NO_MEMORY;
}

/* Whiten columns, (n, q, c), by these gains, each sample over its size, (n, q), or NULL. Sets whitened: (n, q, c). */
EXPORT int64_t kalman_apply(int64_t n, int64_t q, int64_t c, int64_t d, int64_t k, const double *transition,
                            const double *readout, const int64_t *steps, const double *gain, const double *scale,
                            const double *size, const double *columns, double *whitened)
{
    Noise noise = {(size_t)q, (size_t)d, {0}, {0}, NULL, NULL, steps};
    const size_t dc = noise.d * (size_t)c;
    double *memory = calloc(2 * dc + (size_t)c + 1, sizeof *memory), *left = memory;
    const bool there = sparse_make(&noise.transition, transition, (size_t)k * noise.d, noise.d) &&
                       sparse_make(&noise.readout, readout, noise.q, noise.d) && memory;
    if (there) {
        Means m = {.x = taken(&left, dc), .next = taken(&left, dc), .error = taken(&left, (size_t)c)};
        const unsigned control = flush_to_zero();
        if (c == 1)
            innovations(&noise, &m, (size_t)n, gain, scale, size, columns, whitened, 1);
        else
            innovations(&noise, &m, (size_t)n, gain, scale, size, columns, whitened, (size_t)c);
        give_back_control(control);
    }
    noise_free(&noise, memory);
    return there ? FINISHED : NO_MEMORY;
}

/* Take short autoregressions out of whitened columns, (n, q, c), in place, the last row first: of row j and channel i
   the sum of coefficient[l] times row j - 1 - l, then over the deviation. kind: (n) 0 or 1, which of both models of a
   channel holds in a row; behind: (n, q), how many rows a sample has behind it, no more than the order: what predicts by
   so many are the coefficients, (2, q, most + 1, most), and deviations, (2, q, most + 1), of each number of rows.
   Missing samples, (n, q), are zero, and so is what is before the first row. */
EXPORT void kalman_shorten(int64_t n, int64_t q, int64_t c, int64_t most, const double *coefficients,
                           const double *deviation, const unsigned char *kind, const unsigned char *behind,
                           const unsigned char *present, double *columns)
{
    for (int64_t j = n - 1; j >= 0; j--)
        for (int64_t i = 0; i < q; i++) {
            double *restrict y = columns + (j * q + i) * c;
            const int64_t rows = behind[j * q + i], own = (kind[j] * q + i) * (most + 1) + rows;
            if (!present[j * q + i]) {
                memset(y, 0, (size_t)c * sizeof *y);
                continue;
            }
            for (int64_t l = 0; l < rows && l < j; l++) {
                const double *restrict before = y - (l + 1) * q * c;
                const double a = coefficients[own * most + l];
                for (int64_t k = 0; k < c; k++) y[k] -= a * before[k];
            }
            for (int64_t k = 0; k < c; k++) y[k] /= deviation[own];
        }
}

/* Set an upper triangle r, (m, m), to the factor of a matrix of products, r' r = gram, (m, m); 0 where that, its diagonal
   scaled to 1, has an eigenvalue that is not above `least`, or is of no numbers. */
EXPORT int64_t gram_factor(int64_t m, double least, const double *gram, double *r)
{
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

/* Give back what is kept, for a while: the next arrays have it anew. */
EXPORT void memory_give_back(void)
{
#if defined(__GLIBC__)
    malloc_trim(0);
#endif
}

#include "reverse_communication.h"
#include "products.h"
#include "recursions.h"
