/* trust_region: bounded nonlinear least squares by the trust-region reflective method. Knows arrays only.
 *
 *     minimise  |r(x)|^2   over   low < x < high
 *
 * (Branch, Coleman and Li 1999). Every step minimises the linearised sum of squares, in variables that are scaled by
 * the lengths of the Jacobian's columns and by the root of their distance to the bound that the gradient points at,
 * within a radius (More 1978); a step that would leave the bounds is cut there, or reflected, or taken along the
 * gradient, whatever lowers the model most. All iterates lie inside.
 *
 * It asks: whoever answers has the residuals, and may do so for many fits at once, in a worker process or beside it.
 * Of residuals it wants |r|^2, of derivatives J the triangular factor of [J r].
 *
 * A fit may be told an optimum that is known. It ends where it comes next to that, or where derivatives lead there, and
 * where it comes no nearer to its cost.
 */
#ifndef TRUST_REGION_H
#define TRUST_REGION_H

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

/* What is asked of the point x, or how the fit has ended: at x, or at the optimum that was known. */
enum { ASKS_RESIDUALS, ASKS_SLOPES, ENDED, ENDED_AT_KNOWN };

enum { STANDING = 5, SWEEPS = 60 };
#define ORTHOGONAL 1e-15     /* of two columns' lengths: a smaller product is rounding */
#define INSIDE 0.995         /* of the way to a bound, at most */
#define POOR 0.25            /* of the predicted fall: with less the radius shrinks */
#define GOOD 0.75            /* with more it grows */
#define ON_RADIUS 0.01       /* of the radius: how near to it a step's length is brought */
#define CUT 0.95             /* of the radius: a longer step is cut by it */
#define LEAST_GRADIENT 1e-15
#define BESIDE 0.01          /* of a parameter on its scale: a fit that comes so near goes to a known optimum */
#define BESIDE_COST 1.0      /* and of its cost */
#define STANDS 0.05          /* part of what it is above a known cost: if it comes no nearer in STANDING evaluations */

typedef struct {
    int64_t p;           /* parameters */
    int64_t count;       /* residuals */
    int64_t evaluations; /* that are left */
    double ftol, xtol;   /* it ends when its cost falls by less than ftol of itself, or x moves by less than xtol */
    const double *low, *high; /* [p] */
    const double *known;      /* [p]; NULL: none */
    double known_cost;
    /* Where it stands. */
    int64_t asked, seen, tried_once;
    double cost, damping, radius, steepness, predicted, length, best_cost;
    double least[STANDING + 1]; /* the least cost until each of the last evaluations, the last one first */
    double *x, *lengths, *distance, *scale, *g, *d, *squares, *weighted, *tried, *step, *best;
    double *scaled, *back, *way, *found; /* [p] each, [3 p] for found */
    double *turn;   /* [p][p]: right singular vectors, column by column */
    double *a;      /* [p][p + 1]: the model's matrix, column by column */
    double *columns; /* [p][2 p + 1]: that with the bounds' part below it; then its left singular vectors, scaled */
} TrustRegion;

/* Numbers of memory that a fit of p parameters needs. */
static int64_t trust_region_numbers(int64_t p) { return 17 * p + p * p + p * (p + 1) + p * (2 * p + 1); }

static double dot(const double *a, const double *b, int64_t n) {
    double sum = 0.0;
    for (int64_t k = 0; k < n; k++) sum += a[k] * b[k];
    return sum;
}

static double norm(const double *a, int64_t n) { return sqrt(dot(a, a, n)); }

/* Turn the columns, [p][rows], until they are orthogonal: U S of U S V', V' by columns into `turn` (Hestenes 1958). */
static void orthogonalise(double *columns, int64_t rows, int64_t p, double *turn) {
    int turned = 1;
    for (int64_t k = 0; k < p * p; k++) turn[k] = k % (p + 1) == 0 ? 1.0 : 0.0;
    for (int sweep = 0; turned && sweep < SWEEPS; sweep++) {
        turned = 0;
        for (int64_t i = 0; i < p; i++)
            for (int64_t j = i + 1; j < p; j++) {
                double *u = columns + i * rows, *v = columns + j * rows;
                const double across = dot(u, v, rows), uu = dot(u, u, rows), vv = dot(v, v, rows);
                if (!(fabs(across) > ORTHOGONAL * sqrt(uu) * sqrt(vv))) continue;
                const double half = (vv - uu) / (2 * across);
                const double t = (half < 0 ? -1.0 : 1.0) / (fabs(half) + sqrt(1 + half * half));
                const double c = 1 / sqrt(1 + t * t), s = c * t;
                turned = 1;
                for (int which = 0; which < 2; which++) {
                    double *one = which ? turn + i * p : u, *two = which ? turn + j * p : v;
                    for (int64_t k = 0; k < (which ? p : rows); k++) {
                        const double before = one[k];
                        one[k] = c * before - s * two[k];
                        two[k] = s * before + c * two[k];
                    }
                }
            }
    }
}

/* Whether x, of this cost, is next to the known optimum: hardly another, and hardly less likely. */
static int is_beside(const TrustRegion *fit, const double *x, double cost) {
    if (!(fabs(cost - fit->known_cost) < BESIDE_COST)) return 0;
    for (int64_t k = 0; k < fit->p; k++)
        if (!(fabs(x[k] - fit->known[k]) < BESIDE)) return 0;
    return 1;
}

/* Whether derivatives at x, by their triangle of so many rows, predict a least next to the known optimum. */
static int leads_beside(TrustRegion *fit, const double *triangle, int64_t rows) {
    const int64_t p = fit->p;
    const double left = triangle[(p + 1) * (p + 1) - 1], cost = left * left;
    double largest = 0.0;
    if (rows <= p || !(fabs(cost - fit->known_cost) < BESIDE_COST)) return 0;
    for (int64_t j = 0; j < p; j++)
        for (int64_t i = 0; i < p; i++) fit->columns[j * p + i] = triangle[i * (p + 1) + j];
    orthogonalise(fit->columns, p, p, fit->turn);
    memcpy(fit->way, fit->x, (size_t)p * sizeof(double));
    for (int64_t k = 0; k < p; k++) largest = fmax(largest, norm(fit->columns + k * p, p));
    for (int64_t k = 0; k < p; k++) {
        const double *own = fit->columns + k * p, square = dot(own, own, p);
        double along = 0.0;
        if (!(sqrt(square) > DBL_EPSILON * (double)p * largest)) continue; /* of least length where it is not told */
        for (int64_t i = 0; i < p; i++) along += own[i] * triangle[i * (p + 1) + p];
        for (int64_t i = 0; i < p; i++) fit->way[i] -= fit->turn[k * p + i] * along / square;
    }
    return is_beside(fit, fit->way, cost);
}

/* Whether the fit has come hardly nearer to the known cost in its last evaluations. */
static int stands(TrustRegion *fit, double cost) {
    memmove(fit->least + 1, fit->least, STANDING * sizeof(double));
    if (fit->seen == 0 || cost < fit->best_cost) {
        fit->best_cost = cost;
        memcpy(fit->best, fit->seen == 0 ? fit->x : fit->tried, (size_t)fit->p * sizeof(double));
    }
    fit->least[0] = fit->best_cost;
    fit->seen++;
    return fit->seen > STANDING && fit->least[0] - fit->known_cost > (1 - STANDS) *
                                       fmax(fit->least[STANDING] - fit->known_cost, 0.0);
}

/* The model of the sum of squares at x, quadratic in scaled steps: g's + s'(A'A + D)s / 2. */
static void make_model(TrustRegion *fit, const double *triangle) {
    const int64_t p = fit->p, k = p + 1, rows = 2 * p + 1;
    fit->steepness = 0.0;
    memset(fit->columns, 0, (size_t)(p * rows) * sizeof(double));
    for (int64_t j = 0; j < p; j++) {
        double gradient = 0.0, distance = 1.0;
        const double size = 1 / fit->lengths[j];
        int bounded = 1;
        for (int64_t i = 0; i < k; i++) gradient += triangle[i * k + j] * triangle[i * k + p];
        if (gradient < 0 && fit->high[j] < INFINITY) distance = fit->high[j] - fit->x[j];
        else if (gradient > 0 && fit->low[j] > -INFINITY) distance = fit->x[j] - fit->low[j];
        else bounded = 0;
        fit->steepness = fmax(fit->steepness, fabs(gradient * distance));
        fit->distance[j] = bounded ? distance / size : 1.0;
        fit->scale[j] = sqrt(fit->distance[j]) * size;
        fit->g[j] = fit->scale[j] * gradient;
        fit->d[j] = bounded ? fabs(gradient) * size : 0.0;
        for (int64_t i = 0; i < k; i++) {
            fit->a[j * k + i] = triangle[i * k + j] * fit->scale[j];
            fit->columns[j * rows + i] = fit->a[j * k + i];
        }
        fit->columns[j * rows + k + j] = sqrt(fit->d[j]);
    }
    orthogonalise(fit->columns, rows, p, fit->turn);
    for (int64_t j = 0; j < p; j++) {
        const double *own = fit->columns + j * rows;
        fit->squares[j] = dot(own, own, rows);
        fit->weighted[j] = 0.0;
        for (int64_t i = 0; i < k; i++) fit->weighted[j] += own[i] * triangle[i * k + p];
    }
}

/* The step whose parts along the singular vectors are -weighted / (squares + damping). */
static void step_of(TrustRegion *fit, double damping) {
    const int64_t p = fit->p;
    for (int64_t i = 0; i < p; i++) fit->scaled[i] = 0.0;
    for (int64_t k = 0; k < p; k++) {
        const double part = fit->weighted[k] / (fit->squares[k] + damping);
        for (int64_t i = 0; i < p; i++) fit->scaled[i] -= fit->turn[k * p + i] * part;
    }
}

/* By how much the damped step is longer than the radius, and how that changes with the damping. */
static double beyond(const TrustRegion *fit, double damping, double *slope) {
    double square = 0.0, change = 0.0;
    for (int64_t k = 0; k < fit->p; k++) {
        const double damped = fit->squares[k] + damping, part = fit->weighted[k] / damped;
        square += part * part;
        change += part * part / damped;
    }
    *slope = -change / sqrt(square);
    return sqrt(square) - fit->radius;
}

/* Bring the scaled step to the least of the model within the radius; the last damping is a guess. */
static void go_within(TrustRegion *fit) {
    const int64_t p = fit->p;
    double smallest = INFINITY, largest = 0.0, least = 0.0, slope, excess, length;
    for (int64_t k = 0; k < p; k++) {
        smallest = fmin(smallest, fit->squares[k]);
        largest = fmax(largest, fit->squares[k]);
    }
    const int full = sqrt(smallest) > DBL_EPSILON * (double)fit->count * sqrt(largest);
    if (full) {
        step_of(fit, 0.0);
        if (norm(fit->scaled, p) <= fit->radius) {
            fit->damping = 0.0;
            return;
        }
    }
    double most = norm(fit->weighted, p) / fit->radius;
    if (full) {
        excess = beyond(fit, 0.0, &slope);
        least = -excess / slope;
    }
    if (!full && fit->damping == 0.0) fit->damping = fmax(0.001 * most, sqrt(fmax(least * most, 0.0)));
    for (int tries = 0; tries < 10; tries++) {
        if (!(least <= fit->damping && fit->damping <= most))
            fit->damping = fmax(0.001 * most, sqrt(fmax(least * most, 0.0)));
        excess = beyond(fit, fit->damping, &slope);
        if (excess < 0) most = fit->damping;
        least = fmax(least, fit->damping - excess / slope);
        fit->damping -= (excess + fit->radius) / fit->radius * excess / slope;
        if (fabs(excess) < ON_RADIUS * fit->radius) break;
    }
    step_of(fit, fit->damping);
    length = norm(fit->scaled, p);
    for (int64_t k = 0; k < p; k++) fit->scaled[k] *= fit->radius / length;
}

/* Products of the model: (A one)'(A two) + one'D two. */
static double bends(const TrustRegion *fit, const double *one, const double *two) {
    const int64_t p = fit->p, k = p + 1;
    double sum = 0.0;
    for (int64_t i = 0; i < k; i++) {
        double first = 0.0, second = 0.0;
        for (int64_t j = 0; j < p; j++) {
            first += fit->a[j * k + i] * one[j];
            second += fit->a[j * k + i] * two[j];
        }
        sum += first * second;
    }
    for (int64_t j = 0; j < p; j++) sum += one[j] * fit->d[j] * two[j];
    return sum;
}

static double value_of(const TrustRegion *fit, const double *step) {
    return 0.5 * bends(fit, step, step) + dot(fit->g, step, fit->p);
}

/* How far along a way the model is least, between `first` and `last`; `begin`: from there, or NULL. */
static double best_along(const TrustRegion *fit, const double *way, double first, double last, const double *begin) {
    const double curvature = bends(fit, way, way);
    const double slope = dot(fit->g, way, fit->p) + (begin == NULL ? 0.0 : bends(fit, begin, way));
    const double bottom = -slope / curvature, ends[3] = {first, last, bottom};
    double best = first, value = INFINITY;
    for (int k = 0; k < (curvature != 0 && first < bottom && bottom < last ? 3 : 2); k++) {
        const double here = ends[k] * (slope + 0.5 * curvature * ends[k]);
        if (here < value) best = ends[k], value = here;
    }
    return best;
}

/* By how much of a scaled step, taken from x + scale from, the first bound is reached; `from` may be NULL. */
static double part_to_bound(const TrustRegion *fit, const double *from, const double *step, int64_t k) {
    const double move = fit->scale[k] * step[k];
    const double x = fit->x[k] + (from == NULL ? 0.0 : fit->scale[k] * from[k]);
    return move == 0 ? INFINITY : fmax((fit->low[k] - x) / move, (fit->high[k] - x) / move);
}

static double to_bound(const TrustRegion *fit, const double *from, const double *step) {
    double nearest = INFINITY;
    for (int64_t k = 0; k < fit->p; k++) nearest = fmin(nearest, part_to_bound(fit, from, step, k));
    return nearest;
}

/* How far along a way from `begin`, which lies inside, the radius is reached. */
static double to_radius(const double *begin, const double *way, double radius, int64_t p) {
    const double a = dot(way, way, p), b = dot(begin, way, p), c = dot(begin, begin, p) - radius * radius;
    const double q = -(b + copysign(sqrt(fmax(b * b - a * c, 0.0)), b));
    if (a == 0) return 0.0;
    return fmax(q / a, q != 0 ? c / q : 0.0);
}

/* Choose the scaled step that stays inside and lowers the model most. */
static void choose(TrustRegion *fit) {
    const int64_t p = fit->p;
    double *step = fit->scaled, *found = fit->found;
    int many = 1, inside = 1, best = 0;
    for (int64_t k = 0; k < p; k++) {
        const double whole = fit->x[k] + fit->scale[k] * step[k];
        inside = inside && whole >= fit->low[k] && whole <= fit->high[k];
    }
    if (inside) {
        memcpy(fit->step, step, (size_t)p * sizeof(double));
        fit->predicted = -value_of(fit, step);
        return;
    }
    const double part = fmax(INSIDE, 1 - fit->steepness), reached = to_bound(fit, NULL, step);
    for (int64_t k = 0; k < p; k++) {
        const int hit = step[k] != 0 && part_to_bound(fit, NULL, step, k) == reached;
        fit->back[k] = hit ? -step[k] : step[k];
    }
    for (int64_t k = 0; k < p; k++) {
        step[k] *= reached;
        found[k] = part * step[k];
    }
    /* Reflected where the step meets the bound, as far as the next bound or the radius. */
    const double radius = to_radius(step, fit->back, fit->radius, p), bound = to_bound(fit, step, fit->back);
    const double longest = fmin(bound, radius);
    if (longest > 0) {
        const double first = (1 - part) * reached / longest, last = longest == bound ? part * bound : radius;
        if (first <= last) {
            const double far = best_along(fit, fit->back, first, last, step);
            for (int64_t k = 0; k < p; k++) found[many * p + k] = step[k] + far * fit->back[k];
            many++;
        }
    }
    for (int64_t k = 0; k < p; k++) fit->way[k] = -fit->g[k];
    const double down = fit->radius / norm(fit->way, p), edge = to_bound(fit, NULL, fit->way);
    const double far = best_along(fit, fit->way, 0.0, edge < down ? part * edge : down, NULL);
    for (int64_t k = 0; k < p; k++) found[many * p + k] = far * fit->way[k];
    many++;
    fit->predicted = -INFINITY;
    for (int k = 0; k < many; k++) {
        const double falls = -value_of(fit, found + k * p);
        if (falls > fit->predicted) fit->predicted = falls, best = k;
    }
    memcpy(fit->step, found + best * p, (size_t)p * sizeof(double));
}

/* Place `tried` strictly between the bounds. */
static void try_there(TrustRegion *fit) {
    const double *low = fit->low, *high = fit->high;
    for (int64_t k = 0; k < fit->p; k++) {
        double x = fit->x[k] + fit->scale[k] * fit->step[k];
        if (x <= low[k]) x = nextafter(low[k], high[k]);
        else if (x >= high[k]) x = nextafter(high[k], low[k]);
        fit->tried[k] = x < low[k] || x > high[k] ? 0.5 * (low[k] + high[k]) : x;
    }
}

static int64_t ask_next_step(TrustRegion *fit) {
    go_within(fit);
    choose(fit);
    try_there(fit);
    return fit->asked = ASKS_RESIDUALS;
}

/* Begin a fit at x, inside the bounds, in memory of so many numbers; the fit's first fields are the caller's. */
static int64_t trust_region_begin(TrustRegion *fit, const double *x, double *memory) {
    const int64_t p = fit->p;
    double **arrays[] = {&fit->x,       &fit->lengths,  &fit->distance, &fit->scale, &fit->g,
                         &fit->d,       &fit->squares,  &fit->weighted, &fit->tried, &fit->step,
                         &fit->best,    &fit->scaled,   &fit->back,     &fit->way};
    for (size_t k = 0; k < sizeof arrays / sizeof *arrays; k++, memory += p) *arrays[k] = memory;
    fit->found = memory;
    fit->turn = fit->found + 3 * p;
    fit->a = fit->turn + p * p;
    fit->columns = fit->a + p * (p + 1);
    memcpy(fit->x, x, (size_t)p * sizeof(double));
    memcpy(fit->tried, x, (size_t)p * sizeof(double));
    fit->seen = fit->tried_once = 0;
    fit->damping = 0.0, fit->radius = -1.0, fit->length = 0.0, fit->predicted = 0.0, fit->best_cost = INFINITY;
    for (int64_t k = 0; k < p; k++) fit->lengths[k] = 0.0;
    return fit->asked = ASKS_RESIDUALS;
}

/* Take |r|^2 of so many residuals at the point that was tried, infinite where the model failed; ask on. */
static int64_t take_cost(TrustRegion *fit, double cost, int64_t count) {
    const int64_t p = fit->p;
    double fell = -1.0, moved = 0.0, whole = 0.0;
    int ended = 0;
    fit->evaluations--;
    fit->count = count;
    if (fit->known != NULL) {
        if (is_beside(fit, fit->tried, cost)) return fit->asked = ENDED_AT_KNOWN;
        if (stands(fit, cost)) {
            memcpy(fit->x, fit->best, (size_t)p * sizeof(double));
            fit->cost = fit->best_cost;
            return fit->asked = ENDED;
        }
    }
    if (!fit->tried_once) { /* the start */
        fit->tried_once = 1;
        fit->cost = cost;
        return fit->asked = ASKS_SLOPES;
    }
    fit->length = norm(fit->step, p);
    if (!isfinite(cost)) {
        fit->radius = POOR * fit->length;
    } else {
        fell = 0.5 * (fit->cost - cost);
        const double before = fit->radius;
        const double ratio = fit->predicted > 0 ? fell / fit->predicted : fit->predicted == 0 && fell == 0;
        if (ratio < POOR) fit->radius = POOR * fit->length;
        else if (ratio > GOOD && fit->length > CUT * fit->radius) fit->radius *= 2;
        for (int64_t k = 0; k < p; k++) moved += fit->scale[k] * fit->step[k] * fit->scale[k] * fit->step[k];
        whole = norm(fit->x, p);
        ended = (2 * fell < fit->ftol * fit->cost && ratio > POOR) || sqrt(moved) < fit->xtol * (fit->xtol + whole);
        if (!ended) fit->damping *= before / fit->radius;
    }
    if (fell > 0) {
        memcpy(fit->x, fit->tried, (size_t)p * sizeof(double));
        fit->cost = cost;
        if (!ended) return fit->asked = ASKS_SLOPES;
    }
    if (ended || fit->evaluations <= 0) return fit->asked = ENDED;
    return ask_next_step(fit);
}

/* Take the triangular factor of [J r] at x, [p + 1][p + 1], its last rows 0 where it has fewer; ask on. */
static int64_t take_slopes(TrustRegion *fit, const double *triangle, int64_t rows) {
    const int64_t p = fit->p, k = p + 1;
    double square = 0.0;
    if (fit->known != NULL && leads_beside(fit, triangle, rows)) return fit->asked = ENDED_AT_KNOWN;
    for (int64_t j = 0; j < p; j++) {
        double own = 0.0;
        for (int64_t i = 0; i < k; i++) own += triangle[i * k + j] * triangle[i * k + j];
        fit->lengths[j] = fmax(fit->lengths[j], sqrt(own));
        if (fit->radius < 0 && fit->lengths[j] == 0) fit->lengths[j] = 1.0;
    }
    make_model(fit, triangle);
    if (fit->radius < 0) {
        for (int64_t j = 0; j < p; j++)
            square += fit->x[j] * fit->lengths[j] / sqrt(fit->distance[j]) * fit->x[j] * fit->lengths[j] /
                      sqrt(fit->distance[j]);
        fit->radius = square > 0 ? sqrt(square) : 1.0;
    }
    if (fit->steepness < LEAST_GRADIENT || fit->evaluations <= 0) return fit->asked = ENDED;
    return ask_next_step(fit);
}

#endif
