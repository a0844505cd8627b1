/* kalman: the exact whitening of linear Gaussian noise, column by column; factors of small matrices; kept memory.
 * Knows no FMU. What else the program does over all rows, or in steps, is in the headers that are included at the end.
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
