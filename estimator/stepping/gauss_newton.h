/* gauss_newton: the least squares from a start, by Gauss-Newton steps with Levenberg's damping. Knows arrays only.
 *
 * A step that falls about as far as its derivatives say leaves them nearly as they were: they are corrected by what it
 * showed (Broyden 1965) instead of simulated again, f simulations of f values. Near the minimum, where central ones are
 * asked for, they are kept as they are. A minimum is told by simulated ones only. A step that falls short is corrected
 * by what bends beside it, as in a valley that is curved (Transtrum and Sethna 2012).
 *
 * It asks, as trust_region.h does. Of derivatives J and a misfit r it wants the triangle a, (f, f), of J = q a, and
 * g = q'r: |g - a dx| is what a step dx leaves of r.
 */
#ifndef GAUSS_NEWTON_H
#define GAUSS_NEWTON_H

#include "trust_region.h"

/* What is asked. Where the flag `moved` is up the point has moved, to what was tried last. */
enum {
    ASKS_NEW,       /* derivatives at the point, simulated; a and g of them and the misfit there */
    ASKS_CORRECTED, /* a and g of the derivatives that there are, corrected by the last step if `corrects` is up */
    ASKS_COST,      /* the cost at the tried point */
    ASKS_BENT,      /* a and g of the derivatives and what they predict at the tried point, less what is there */
    DONE,           /* at the point */
    DONE_BESIDE     /* at the least cost that is known */
};

#define FIRST_DAMPING 1e-3
#define LAST_DAMPING 1e8
#define LEAST_DAMPING 1e-9
#define HOPE 4.0           /* times the whole fall that derivatives predict: a fit that needs more to be wanted ends */
#define LEADS_WITHIN 1.0   /* of the cost, and bars: a fit that is led so near to a known least goes there */

typedef struct {
    int64_t f;                /* what is free */
    int64_t iterations;       /* how often derivatives are simulated, at most */
    int64_t rounds;           /* steps, at most */
    int64_t fine;             /* derivatives are central */
    int64_t told;             /* derivatives are simulated where it ends */
    double tolerance;         /* of the cost: it ends when the predicted fall is smaller */
    double limit;             /* of the cost: it ends where it has no hope of less */
    double least_part, most_part; /* of the predicted fall: between, derivatives are corrected, not simulated again */
    double known_cost;        /* of a least cost that is known */
    const double *known, *bars; /* [f]: where that is, and its standard errors; NULL: there is none */
    const double *low, *high, *longest; /* [f]: bounds, and the longest step */
    /* Where it stands. */
    int64_t left, simulated, have, moved, corrects, bent;
    double cost, damping, predicted;
    double *x, *tried, *g, *bend, *dx, *scale, *rest; /* [f] each */
    double *a, *normal, *turn;                 /* [f][f] each, row by row */
    int64_t *open;                             /* [f] */
} GaussNewton;

/* Numbers of memory that a fit of f values needs. */
static int64_t gauss_newton_numbers(int64_t f) { return 8 * f + 3 * f * f; }

/* The damped step that minimises |g - a dx| among those within the bounds and no longer than the longest, into dx.
 *
 * What would go further stays at its edge, and the others are solved for beside it: the logarithm of a number that is
 * nearly zero changes nothing, and its step is as long as one likes. A step that is shortened for it moves nothing. */
static void damped_step(GaussNewton *fit, const double *a, const double *g, const double *x) {
    const int64_t f = fit->f;
    int64_t many = 0, *open = fit->open;
    double *scale = fit->scale, *normal = fit->normal, *dx = fit->dx, *rest = fit->rest;
    for (int64_t k = 0; k < f; k++) open[many++] = k;
    memcpy(rest, g, (size_t)f * sizeof(double));
    while (many > 0) {
        double furthest = 1.0, edge = 0.0;
        int64_t worst = -1;
        for (int64_t i = 0; i < many; i++) {
            double square = 0.0;
            for (int64_t r = 0; r < f; r++) square += a[r * f + open[i]] * a[r * f + open[i]];
            scale[i] = square > 0 ? sqrt(square) : 1.0;
        }
        for (int64_t i = 0; i < many; i++) { /* Cholesky's factor of the damped products, and its inverse on a'g */
            double along = 0.0;
            for (int64_t r = 0; r < f; r++) along += a[r * f + open[i]] / scale[i] * rest[r];
            for (int64_t j = 0; j <= i; j++) {
                double product = i == j ? fit->damping : 0.0;
                for (int64_t r = 0; r < f; r++)
                    product += a[r * f + open[i]] / scale[i] * (a[r * f + open[j]] / scale[j]);
                for (int64_t l = 0; l < j; l++) product -= normal[i * f + l] * normal[j * f + l];
                normal[i * f + j] = i == j ? sqrt(fmax(product, DBL_MIN)) : product / normal[j * f + j];
                if (j < i) along -= normal[i * f + j] * dx[open[j]];
            }
            dx[open[i]] = along / normal[i * f + i];
        }
        for (int64_t i = many - 1; i >= 0; i--) {
            for (int64_t l = i + 1; l < many; l++) dx[open[i]] -= normal[l * f + i] * dx[open[l]];
            dx[open[i]] /= normal[i * f + i];
        }
        for (int64_t i = 0; i < many; i++) dx[open[i]] /= scale[i];
        for (int64_t i = 0; i < many; i++) {
            const int64_t k = open[i];
            const double least = fmax(fmin(fit->low[k] - x[k], 0.0), -fit->longest[k]);
            const double most = fmin(fmax(fit->high[k] - x[k], 0.0), fit->longest[k]);
            const double end = dx[k] < 0 ? least : most, times = fabs(dx[k]) / fmax(fabs(end), 1e-300);
            if (times > furthest) furthest = times, worst = i, edge = end;
        }
        if (worst < 0) return;
        const int64_t k = open[worst];
        dx[k] = edge;
        for (int64_t r = 0; r < f; r++) rest[r] -= a[r * f + k] * edge;
        open[worst] = open[--many];
    }
}

static double between(double x, double low, double high) { return fmin(fmax(x, low), high); }

static int64_t next_round(GaussNewton *fit) {
    if (fit->rounds-- <= 0) return DONE;
    if (fit->have) return ASKS_CORRECTED;
    if (fit->left <= 0) return DONE;
    fit->have = fit->simulated = 1;
    fit->left--;
    return ASKS_NEW;
}

/* There is no point of less cost. */
static int64_t end_of_steps(GaussNewton *fit) {
    if (fit->simulated || !fit->told) return DONE;
    fit->have = fit->corrects = 0; /* what was corrected tells no minimum */
    return next_round(fit);
}

static int64_t try_step(GaussNewton *fit) {
    const int64_t f = fit->f;
    double square = 0.0, left = 0.0;
    if (!(fit->damping < LAST_DAMPING)) return end_of_steps(fit);
    damped_step(fit, fit->a, fit->g, fit->x);
    for (int64_t k = 0; k < f; k++) fit->tried[k] = between(fit->x[k] + fit->dx[k], fit->low[k], fit->high[k]);
    for (int64_t r = 0; r < f; r++) {
        double rest = fit->g[r];
        for (int64_t k = 0; k < f; k++) rest -= fit->a[r * f + k] * (fit->tried[k] - fit->x[k]);
        square += fit->g[r] * fit->g[r];
        left += rest * rest;
    }
    fit->predicted = square - left;
    if (fit->predicted < fit->tolerance) return end_of_steps(fit);
    fit->bent = 0;
    return ASKS_COST;
}

/* Begin at x, whose cost is known; `have`: and derivatives too. */
static int64_t gauss_newton_begin(GaussNewton *fit, const double *x, double cost, int64_t have, double *memory) {
    const int64_t f = fit->f;
    double **rows[] = {&fit->x, &fit->tried, &fit->g, &fit->bend, &fit->dx, &fit->scale, &fit->rest};
    double **squares[] = {&fit->a, &fit->normal, &fit->turn};
    for (int k = 0; k < 7; k++, memory += f) *rows[k] = memory;
    for (int k = 0; k < 3; k++, memory += f * f) *squares[k] = memory;
    fit->open = (int64_t *)(void *)memory;
    memcpy(fit->x, x, (size_t)f * sizeof(double));
    memcpy(fit->tried, x, (size_t)f * sizeof(double));
    fit->cost = cost, fit->damping = FIRST_DAMPING, fit->left = fit->iterations, fit->simulated = 1, fit->have = have;
    fit->moved = fit->corrects = fit->bent = 0;
    return f > 0 && isfinite(cost) ? next_round(fit) : DONE;
}

/* Whether derivatives predict a least next to the known one, as low and not apart from it. */
static int leads_to_known(GaussNewton *fit, double square) {
    const int64_t f = fit->f;
    double *columns = fit->normal, *ahead = fit->dx, largest = 0.0;
    if (!(fabs(fit->cost - square - fit->known_cost) <= LEADS_WITHIN)) return 0;
    for (int64_t r = 0; r < f; r++)
        for (int64_t k = 0; k < f; k++) columns[k * f + r] = fit->a[r * f + k];
    orthogonalise(columns, f, f, fit->turn);
    for (int64_t k = 0; k < f; k++) largest = fmax(largest, norm(columns + k * f, f));
    memcpy(ahead, fit->x, (size_t)f * sizeof(double));
    for (int64_t k = 0; k < f; k++) {
        const double own = dot(columns + k * f, columns + k * f, f);
        if (!(sqrt(own) > DBL_EPSILON * (double)f * largest)) continue;
        for (int64_t i = 0; i < f; i++) ahead[i] += fit->turn[k * f + i] * dot(columns + k * f, fit->g, f) / own;
    }
    for (int64_t k = 0; k < f; k++)
        if (!(fabs(ahead[k] - fit->known[k]) < LEADS_WITHIN * fit->bars[k])) return 0;
    return 1;
}

/* Take a and g, at the point, or of what bends; ask on. */
static int64_t take_triangle(GaussNewton *fit, const double *a, const double *g, int bends) {
    const int64_t f = fit->f;
    const double square = dot(g, g, f);
    fit->moved = fit->corrects = 0;
    if (bends) {
        damped_step(fit, a, g, fit->tried);
        for (int64_t k = 0; k < f; k++)
            fit->tried[k] = between(fit->tried[k] + fit->dx[k], fit->low[k], fit->high[k]);
        fit->bent = 1;
        return ASKS_COST;
    }
    memcpy(fit->a, a, (size_t)(f * f) * sizeof(double));
    memcpy(fit->g, g, (size_t)f * sizeof(double));
    if (fit->simulated && fit->left < fit->iterations - 1 && fit->cost - HOPE * square > fit->limit) return DONE;
    if (fit->known != NULL && leads_to_known(fit, square)) return DONE_BESIDE;
    return try_step(fit);
}

/* How much of what a step missed goes into each derivative, [f] into `bend`: as the whitened signals weigh it. */
static void correction(GaussNewton *fit) {
    const int64_t f = fit->f;
    double along = 0.0;
    for (int64_t k = 0; k < f; k++) {
        fit->bend[k] = 0.0;
        for (int64_t r = 0; r < f; r++) fit->bend[k] += fit->a[r * f + k] * fit->a[r * f + k];
        fit->bend[k] *= fit->dx[k];
        along += fit->bend[k] * fit->dx[k];
    }
    for (int64_t k = 0; k < f; k++) fit->bend[k] /= along;
}

/* Take the cost at the tried point, infinite where the FMU failed; ask on. */
static int64_t take_tried(GaussNewton *fit, double cost) {
    const double gained = fit->cost - cost;
    fit->moved = 0;
    if (fit->simulated && !fit->bent && fit->cost <= cost && isfinite(cost)) return ASKS_BENT;
    if (!(cost < fit->cost)) {
        if (!fit->simulated) return end_of_steps(fit);
        fit->damping *= 10;
        return try_step(fit);
    }
    const double ratio = gained / fit->predicted;
    const int last = gained < fit->tolerance && fit->simulated;
    fit->damping = fmax(fit->damping / 10, LEAST_DAMPING);
    fit->have = gained >= fit->tolerance && fit->least_part < ratio && ratio < fit->most_part;
    if (fit->have) fit->simulated = 0;
    fit->corrects = fit->have && !fit->fine;
    for (int64_t k = 0; k < fit->f; k++) {
        fit->dx[k] = fit->tried[k] - fit->x[k];
        fit->x[k] = fit->tried[k];
    }
    if (fit->corrects) correction(fit);
    fit->cost = cost;
    fit->moved = 1;
    return last ? DONE : next_round(fit);
}

#endif
