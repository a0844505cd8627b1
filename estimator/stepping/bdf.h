/* bdf: CVode of SUNDIALS 7, for stretches that hold an explicit method to small steps (stiff equations).
 *
 * Knows x' = f(t, x) as dop853.h does. The functions come from outside, as addresses, in the order of Sundials; there
 * may be none. One step at a time; what lies within the last step is asked for by time.
 */
#ifndef BDF_H
#define BDF_H

#include <stdint.h>
#include <string.h>

#include "dop853.h"

enum { CV_BDF_METHOD = 2, CV_ONE_STEP_TASK = 2, CV_RECOVER = 1, CV_GIVE_UP = -1, NO_COMM = 0 };

typedef int BdfRates(double t, void *x, void *slope, void *data);

/* SUNDIALS' functions. All or none. */
typedef struct {
    int (*context_create)(int comm, void **context);
    int (*context_clear_handlers)(void *context);
    int (*context_free)(void **context);
    void *(*vector_new)(int64_t n, void *context);
    double *(*vector_data)(void *vector);
    void (*vector_destroy)(void *vector);
    void *(*matrix_new)(int64_t rows, int64_t columns, void *context);
    void (*matrix_destroy)(void *matrix);
    void *(*solver_new)(void *vector, void *matrix, void *context);
    int (*solver_free)(void *solver);
    void *(*create)(int method, void *context);
    int (*init)(void *memory, BdfRates *rates, double t, void *x);
    int (*reinit)(void *memory, double t, void *x);
    int (*tolerances)(void *memory, double relative, void *absolute);
    int (*set_solver)(void *memory, void *solver, void *matrix);
    int (*set_data)(void *memory, void *data);
    int (*set_stop)(void *memory, double t);
    int (*step)(void *memory, double t, void *x, double *reached, int task);
    int (*within)(void *memory, double t, int derivative, void *x);
    void (*free)(void **memory);
} Sundials;

/* One integration, and the memory that it needs. */
typedef struct {
    const Sundials *sundials;
    void *context, *x, *shown, *absolute, *matrix, *solver, *memory;
    Derivatives *derivatives;
    void *of;          /* what the derivatives are given */
    size_t n;
    double t0, t1;     /* of the last step */
    int status;        /* of the derivatives, when they last failed */
} Bdf;

static int bdf_rates(double t, void *x, void *slope, void *data) {
    Bdf *b = data;
    const int status = b->derivatives(b->of, t, b->sundials->vector_data(x), b->sundials->vector_data(slope));
    if (status != 0) b->status = status;
    return status == 0 ? 0 : status == 2 ? CV_RECOVER : CV_GIVE_UP; /* 2: fmi2Discard, a shorter step may do */
}

static void bdf_close(Bdf *b) {
    const Sundials *s = b->sundials;
    if (b->memory != NULL) s->free(&b->memory);
    if (b->solver != NULL) (void)s->solver_free(b->solver);
    if (b->matrix != NULL) s->matrix_destroy(b->matrix);
    if (b->x != NULL) s->vector_destroy(b->x);
    if (b->shown != NULL) s->vector_destroy(b->shown);
    if (b->absolute != NULL) s->vector_destroy(b->absolute);
    if (b->context != NULL) (void)s->context_free(&b->context);
    memset(b, 0, sizeof *b);
}

/* Begin at t with states x. Return whether that worked. */
static int bdf_begin(Bdf *b, const Sundials *s, Derivatives *f, void *of, double t, const Explicit *like) {
    const size_t bytes = like->n * sizeof(double);
    int good;
    if (b->memory == NULL) {
        *b = (Bdf){.sundials = s, .n = like->n};
        if (s->context_create(NO_COMM, &b->context) != 0) return 0;
        (void)s->context_clear_handlers(b->context);
        b->x = s->vector_new((int64_t)like->n, b->context);
        b->shown = s->vector_new((int64_t)like->n, b->context);
        b->absolute = s->vector_new((int64_t)like->n, b->context);
        b->matrix = s->matrix_new((int64_t)like->n, (int64_t)like->n, b->context);
        b->memory = s->create(CV_BDF_METHOD, b->context);
        good = b->x != NULL && b->shown != NULL && b->absolute != NULL && b->matrix != NULL && b->memory != NULL;
        b->solver = good ? s->solver_new(b->x, b->matrix, b->context) : NULL;
        good = good && b->solver != NULL && s->init(b->memory, bdf_rates, t, b->x) == 0 &&
               s->set_solver(b->memory, b->solver, b->matrix) == 0 && s->set_data(b->memory, b) == 0;
        if (!good) {
            bdf_close(b);
            return 0;
        }
    }
    b->derivatives = f;
    b->of = of;
    b->t0 = b->t1 = t;
    memcpy(s->vector_data(b->x), like->x1, bytes);
    memcpy(s->vector_data(b->absolute), like->absolute, bytes);
    return s->reinit(b->memory, t, b->x) == 0 && s->tolerances(b->memory, like->relative, b->absolute) == 0;
}

/* Take one step, not beyond `most`. Return 0, or a status. */
static int bdf_step(Bdf *b, double most) {
    int flag;
    b->status = 0;
    if (b->sundials->set_stop(b->memory, most) != 0) return 3;
    b->t0 = b->t1;
    flag = b->sundials->step(b->memory, most, b->x, &b->t1, CV_ONE_STEP_TASK);
    return flag >= 0 ? 0 : b->status != 0 ? b->status : 3;
}

/* The states at t within the last step. */
static int bdf_at(Bdf *b, double t, double *x) {
    void *from = b->x;
    if (t != b->t1) {
        if (b->sundials->within(b->memory, t, 0, b->shown) != 0) return 3;
        from = b->shown;
    }
    memcpy(x, b->sundials->vector_data(from), b->n * sizeof *x);
    return 0;
}

#endif
