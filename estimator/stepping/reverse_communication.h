/* reverse_communication: the steps of trust_region.h and gauss_newton.h for who answers from outside, call by call.
 * Included by kalman.c, which has EXPORT. */
#ifndef REVERSE_COMMUNICATION_H
#define REVERSE_COMMUNICATION_H

#include "gauss_newton.h"
#include "trust_region.h"

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

#endif
