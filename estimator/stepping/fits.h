/* fits: whole least-squares fits of a job, from start to optimum. Part of stepper.c: knows candidates and costs.
 *
 * A fit by trust_region.h or gauss_newton.h asks for residuals some ten times, and for derivatives nearly as often.
 * Where a simulation takes microseconds, messages and arrays around each of these cost far more than it does. A
 * simulation that fails ends all: whoever asked does it by single candidates then.
 */

/* Where parameters go in a candidate. */
typedef struct {
    int64_t parameters;
    const double *low, *high;    /* [parameters]: bounds, on their scales */
    const double *lower, *upper; /* [parameters]: the same in their units */
    const int64_t *log;          /* [parameters]: whether their scale is logarithmic */
    const int64_t *column;       /* [experiments][values of the job]: the parameter that sets it; -1: none */
    const double *gain;          /* [experiments][values of the job] */
    const double *shift;         /* [experiments][values of the job]: added to gain times parameter; alone where none */
    int64_t simulations, steps;  /* that were done */
} Places;

/* Fits by trust_region.h, of residuals that an output's deviation weighs, with one-sided differences. */
typedef struct {
    Places places;
    int64_t starts, evaluations;
    double ftol, xtol;
    double least_step;     /* of differences: of a logarithm, or times a parameter's size */
    double known_cost;
    const double *known;   /* [parameters], on their scales: an optimum that is known; NULL: none */
    const double *start;   /* [starts][parameters], on their scales, inside the bounds */
    const double *weights; /* [outputs]: 1 / deviation */
    double *ends;          /* [starts][parameters]: where each fit has ended, on their scales */
    double *costs;         /* [starts]: sums of weighted squares there */
    int64_t *ended;        /* [starts]: ENDED or ENDED_AT_KNOWN */
} Fits;

/* A descent by gauss_newton.h, of misfits that each sample weighs. */
typedef struct {
    Places places;
    int64_t iterations, rounds, fine, told;
    double tolerance, limit, least_part, most_part;
    double known_cost;
    const double *known, *bars; /* [parameters]: a least cost that is known, and its bars; NULL: none */
    const double *longest;      /* [parameters]: the longest step */
    const double *steps;        /* [parameters]: of differences */
    double *x;                  /* [parameters], on their scales: the start, then where it has ended */
    double *samples;            /* [rows][outputs]: weights, 0 where a sample is missing; then what is shown at the end,
                                   and, in as many more, the derivatives of that, where `knows` is up */
    double cost;
    int64_t ended, knows;
} Descent;

/* What fits work with: what is tried first, then a candidate beside the point for each difference. */
typedef struct {
    Fmu *fmu;
    const Job *job;
    const FloatingPoint *saved;
    Places *places;
    int64_t *claim;
    Batch batch;
    double *values;      /* of the batch */
    int64_t size, count; /* samples of all experiments; rows of the matrix */
    double *matrix;      /* [parameters + 1][count]: derivatives, then residuals */
    double *forward;     /* [parameters]: steps of the differences */
    double *triangle;    /* [parameters + 1][parameters + 1] */
    double *more;        /* what else was asked for */
} Fitting;

/* Write a candidate's values: x, with one parameter moved by a step; `which` -1: none. */
static void place(const Fitting *f, const double *x, int64_t which, double step, int64_t index) {
    const Places *places = f->places;
    const int64_t stride = f->job->parameters + f->job->sensor_values, all = f->job->experiments * stride;
    double *values = f->values + index * all;
    for (int64_t v = 0; v < all; v++) {
        const int64_t k = places->column[v];
        double value = 0.0;
        if (k >= 0) {
            const double own = k == which ? x[k] + step : x[k];
            value = places->log[k] ? exp(own) : own;
            if (k != which) value = fmin(fmax(value, places->lower[k]), places->upper[k]);
            value *= places->gain[v];
        }
        values[v] = value + places->shift[v];
    }
}

static int simulate_placed(Fitting *f, int64_t index) {
    f->batch.steps[index] = 0;
    *f->claim = f->places->simulations++;
    const int64_t outcome = sound_candidate(f->fmu, f->job, &f->batch, index, f->saved);
    f->places->steps += f->batch.steps[index];
    return outcome == FINISHED;
}

/* Write a column of the matrix: weighted residuals of what was tried, or their derivative by parameter `which`. */
static void fill(const Fitting *f, const double *weights, int64_t which) {
    const int64_t p = f->places->parameters, outputs = f->job->outputs;
    const double *here = f->batch.shown, *there = here + (which + 1) * f->size;
    double *column = f->matrix + (which < 0 ? p : which) * f->count;
    for (int64_t e = 0; e < f->job->experiments; e++) {
        const Experiment *experiment = &f->job->experiment[e];
        const double *measured = experiment->measured;
        for (int64_t k = 0; k < experiment->samples; k++)
            for (int64_t j = 0; j < outputs; j++, here++, there++, measured++) {
                if (isnan(*measured)) continue;
                const double off = which < 0 ? *here - *measured : (*there - *here) / f->forward[which];
                *column++ = off * weights[j];
            }
    }
}

static double long_dot(const double *a, const double *b, int64_t n) {
    double sums[4] = {0.0, 0.0, 0.0, 0.0};
    int64_t k = 0;
    for (; k + 4 <= n; k += 4)
        for (int64_t i = 0; i < 4; i++) sums[i] += a[k + i] * b[k + i];
    for (; k < n; k++) sums[0] += a[k] * b[k];
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

/* The triangular factor of the matrix by Householder's reflections; the matrix is lost. Returns its rows. */
static int64_t triangular(Fitting *f) {
    double *triangle = f->triangle;
    const int64_t k = f->places->parameters + 1, n = f->count, rows = n < k ? n : k;
    memset(triangle, 0, (size_t)(k * k) * sizeof(double));
    for (int64_t j = 0; j < rows; j++) {
        double *own = f->matrix + j * n + j;
        const double length = sqrt(long_dot(own, own, n - j)), end = own[0] > 0 ? -length : length;
        triangle[j * k + j] = end;
        if (length == 0) {
            for (int64_t l = j + 1; l < k; l++) triangle[j * k + l] = f->matrix[l * n + j];
            continue;
        }
        own[0] -= end;
        const double square = -end * own[0]; /* half of the reflected vector's */
        for (int64_t l = j + 1; l < k; l++) {
            double *other = f->matrix + l * n + j;
            const double part = long_dot(own, other, n - j) / square;
            for (int64_t i = 0; i < n - j; i++) other[i] -= part * own[i];
            triangle[j * k + l] = other[0];
        }
    }
    return rows;
}

/* Do one fit; 0: a simulation has failed. */
static int one_fit(Fitting *f, const Fits *fits, int64_t s) {
    const Places *places = f->places;
    const int64_t p = places->parameters;
    TrustRegion fit = {.p = p, .evaluations = fits->evaluations, .ftol = fits->ftol, .xtol = fits->xtol,
                       .low = places->low, .high = places->high, .known = fits->known, .known_cost = fits->known_cost};
    int64_t asked = trust_region_begin(&fit, fits->start + s * p, f->more);
    while (asked == ASKS_RESIDUALS || asked == ASKS_SLOPES) {
        if (asked == ASKS_RESIDUALS) {
            const double *r = f->matrix + p * f->count;
            place(f, fit.tried, -1, 0.0, 0);
            if (!simulate_placed(f, 0)) return 0;
            fill(f, fits->weights, -1);
            asked = take_cost(&fit, long_dot(r, r, f->count), f->count);
            continue;
        }
        for (int64_t k = 0; k < p; k++) { /* ahead, or back where a bound is near */
            const double size = places->log[k] ? 1.0 : fmax(fabs(fit.x[k]), 1e-3 * (places->high[k] - places->low[k]));
            const double step = fits->least_step * size;
            f->forward[k] = fit.x[k] + step <= places->high[k] ? step : -step;
            place(f, fit.x, k, f->forward[k], k + 1);
            if (!simulate_placed(f, k + 1)) return 0;
            fill(f, fits->weights, k);
        }
        fill(f, fits->weights, -1); /* the last triangle has taken it */
        const int64_t rows = triangular(f);
        asked = take_slopes(&fit, f->triangle, rows);
    }
    memcpy(fits->ends + s * p, fit.x, (size_t)p * sizeof(double));
    fits->costs[s] = fit.cost;
    fits->ended[s] = asked;
    return 1;
}

/* What the samples show less than was measured, weighed, [size]. */
static void weigh(const Fitting *f, const double *weights, double *misfit) {
    const double *shown = f->batch.shown;
    for (int64_t e = 0, k = 0; e < f->job->experiments; e++) {
        const double *measured = f->job->experiment[e].measured;
        for (int64_t i = 0; i < f->job->experiment[e].samples * f->job->outputs; i++, k++)
            misfit[k] = weights[k] != 0 ? (measured[i] - shown[k]) * weights[k] : 0.0;
    }
}

/* Simulate derivatives at x: weighed into the columns, [parameters][size]; unweighed they stay in the batch. */
static int differentiate(Fitting *f, const Descent *d, const double *x, const double *here, double *columns) {
    const Places *places = f->places;
    const int64_t p = places->parameters, n = f->size;
    for (int64_t k = 0; k < p; k++) {
        const double h = d->steps[k], ahead = x[k] + h <= places->high[k] ? h : -h;
        const int both = d->fine && x[k] - h >= places->low[k] && ahead > 0;
        double *there = f->batch.shown + (k + 1) * n, *column = columns + k * n;
        const double *back = both ? there + p * n : here;
        place(f, x, k, ahead, k + 1);
        if (!simulate_placed(f, k + 1)) return 0;
        if (both) {
            place(f, x, k, -h, k + 1 + p);
            if (!simulate_placed(f, k + 1 + p)) return 0;
        }
        const double width = both ? 2 * h : ahead;
        for (int64_t i = 0; i < n; i++) {
            there[i] = (there[i] - back[i]) / width;
            column[i] = d->samples[i] != 0 ? there[i] * d->samples[i] : 0.0;
        }
    }
    return 1;
}

/* Give a and g of the columns and a misfit, [size]. */
static int64_t give_triangle(Fitting *f, GaussNewton *fit, const double *columns, const double *misfit, int bends) {
    const int64_t p = f->places->parameters, k = p + 1, n = f->size;
    double *a = f->forward, *g = a + p * p;
    memcpy(f->matrix, columns, (size_t)(p * n) * sizeof(double));
    memcpy(f->matrix + p * n, misfit, (size_t)n * sizeof(double));
    (void)triangular(f);
    for (int64_t i = 0; i < p; i++) {
        memcpy(a + i * p, f->triangle + i * k, (size_t)p * sizeof(double));
        g[i] = f->triangle[i * k + p];
    }
    return take_triangle(fit, a, g, bends);
}

/* Do a descent; 0: a simulation has failed. */
static int one_descent(Fitting *f, Descent *d) {
    const Places *places = f->places;
    const int64_t p = places->parameters, n = f->size;
    double *columns = f->more, *misfit = columns + p * n, *tried = misfit + n, *here = tried + n, *memory = here + n;
    GaussNewton fit = {.f = p, .iterations = d->iterations, .rounds = d->rounds, .fine = d->fine, .told = d->told,
                       .tolerance = d->tolerance, .limit = d->limit, .least_part = d->least_part,
                       .most_part = d->most_part, .low = places->low, .high = places->high, .longest = d->longest,
                       .known = d->known, .bars = d->bars, .known_cost = d->known_cost};
    place(f, d->x, -1, 0.0, 0);
    if (!simulate_placed(f, 0)) return 0;
    memcpy(here, f->batch.shown, (size_t)n * sizeof(double));
    weigh(f, d->samples, misfit);
    int64_t asked = gauss_newton_begin(&fit, d->x, long_dot(misfit, misfit, n), 0, memory);
    for (;;) {
        if (fit.moved) {
            if (fit.corrects)
                for (int64_t i = 0; i < n; i++) {
                    double missed = misfit[i] - tried[i];
                    for (int64_t k = 0; k < p; k++) missed -= columns[k * n + i] * fit.dx[k];
                    for (int64_t k = 0; k < p; k++) columns[k * n + i] += fit.bend[k] * missed;
                }
            memcpy(misfit, tried, (size_t)n * sizeof(double));
            memcpy(here, f->batch.shown, (size_t)n * sizeof(double));
        }
        if (asked == DONE || asked == DONE_BESIDE) break;
        if (asked == ASKS_COST) {
            place(f, fit.tried, -1, 0.0, 0);
            if (!simulate_placed(f, 0)) return 0;
            weigh(f, d->samples, tried);
            asked = take_tried(&fit, long_dot(tried, tried, n));
            continue;
        }
        if (asked == ASKS_NEW && !differentiate(f, d, fit.x, here, columns)) return 0;
        if (asked == ASKS_BENT) { /* what the derivatives predict there, less what is there */
            for (int64_t i = 0; i < n; i++) {
                tried[i] -= misfit[i];
                for (int64_t k = 0; k < p; k++) tried[i] += columns[k * n + i] * (fit.tried[k] - fit.x[k]);
            }
        }
        asked = give_triangle(f, &fit, columns, asked == ASKS_BENT ? tried : misfit, asked == ASKS_BENT);
    }
    memcpy(d->x, fit.x, (size_t)p * sizeof(double));
    d->cost = fit.cost, d->ended = asked, d->knows = d->fine && fit.have && fit.simulated;
    memcpy(d->samples, here, (size_t)n * sizeof(double));
    if (d->knows) memcpy(d->samples + n, f->batch.shown + n, (size_t)(p * n) * sizeof(double));
    return 1;
}

/* Take memory for candidates, a matrix of so many rows, 0: as many as samples are there, and more numbers. */
static int prepare(Fitting *f, Fmu *fmu, const Job *job, int64_t *claim, Places *places, int64_t candidates,
                   int64_t rows, int64_t more) {
    const int64_t p = places->parameters, n = candidates;
    const int64_t values = job->experiments * (job->parameters + job->sensor_values);
    *f = (Fitting){.fmu = fmu, .job = job, .places = places, .claim = claim, .count = rows};
    if (job->outputs > MAX_OUTPUTS || job->inputs > MAX_INPUTS) return 0;
    for (int64_t e = 0; e < job->experiments; e++) {
        const int64_t size = job->experiment[e].samples * job->outputs;
        f->size += size;
        for (int64_t k = 0; rows == 0 && k < size; k++) f->count += !isnan(job->experiment[e].measured[k]);
    }
    const int64_t all = n * (values + f->size + 4) + (p + 1) * (f->count + 2 * (p + 1)) + more;
    double *at = malloc((size_t)all * sizeof(double));
    if (at == NULL) return 0;
    f->values = at;
    f->batch = (Batch){.claim = claim, .candidates = n, .quota = n, .refine = 1, .values = at};
    at += n * values;
    f->batch.bounds = at;
    for (int64_t k = 0; k < n; k++) *at++ = INFINITY;
    f->batch.costs = at, at += n;
    f->batch.steps = (int64_t *)(void *)at, at += n;
    f->batch.outcomes = (int64_t *)(void *)at, at += n;
    f->batch.shown = at, at += n * f->size;
    f->matrix = at, at += (p + 1) * f->count;
    f->triangle = at, at += (p + 1) * (p + 1);
    f->forward = at, at += (p + 1) * (p + 1);
    f->more = at;
    return 1;
}

/* Do all fits. Returns 1; 0: a simulation has failed, or there is no memory. */
EXPORT int64_t stepper_fit(Fmu *fmu, const Job *job, int64_t *claim, Fits *fits) {
    const int64_t p = fits->places.parameters;
    FloatingPoint saved;
    Fitting f;
    int64_t sound = prepare(&f, fmu, job, claim, &fits->places, p + 1, 0, trust_region_numbers(p));
    remember(&saved);
    f.saved = &saved;
    for (int64_t s = 0; s < fits->starts && sound; s++) sound = one_fit(&f, fits, s);
    *claim = -1;
    free(f.values);
    return sound;
}

/* Do a descent. Returns as `stepper_fit`. */
EXPORT int64_t stepper_descend(Fmu *fmu, const Job *job, int64_t *claim, Descent *descent) {
    const int64_t p = descent->places.parameters;
    FloatingPoint saved;
    Fitting f;
    int64_t size = 0;
    for (int64_t e = 0; e < job->experiments; e++) size += job->experiment[e].samples * job->outputs;
    int64_t sound = prepare(&f, fmu, job, claim, &descent->places, 2 * p + 1, size,
                            (p + 3) * size + gauss_newton_numbers(p));
    remember(&saved);
    f.saved = &saved;
    if (sound) sound = one_descent(&f, descent);
    *claim = -1;
    free(f.values);
    return sound;
}
