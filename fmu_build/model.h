/* The contract between a model and the code around it. A model file is
 *
 *     (a comment: the first sentence says what the model is; then the equations)
 *     #define MODEL_LINEAR 1          1: the derivatives are linear in the states; 0: they are not
 *     #define MODEL_VARIABLES(X) \    one line a variable, SI units
 *         X(kind, name, start, nominal, min, max, unit, description) \
 *         ...
 *     #include "model.h"
 *     static void derivatives(const Variables *m, Derivatives *d) { ... }
 *
 * Kinds
 *     input        held from one communication point to the next
 *     parameter    may be set before and between steps
 *     state        an output that is integrated: `derivatives` sets d->name to its derivative
 *     output       an output that is calculated: `derivatives` sets d->name to its value; its start is not used
 *     mode         a whole number that stays as it is until the model leaves that mode (below); it starts from start
 *
 * `derivatives` reads m, sets every member of d, and keeps nothing from call to call. Inputs and parameters are within
 * min and max whenever a step is made. nominal is a typical magnitude (> 0); it scales the errors of states.
 *
 * A model with modes, such as one with dry friction, has two functions more:
 *
 *     static void switches(const Variables *m, Switches *s) { ... }
 *     static void enter(Variables *m) { ... }
 *
 * `switches` sets, for every mode, s->name.margin, how far the model is from leaving it, and s->name.next, the mode that
 * it leaves it for. A mode lasts while its margin is not below 0. Margins are continuous in the states; the instant at
 * which one falls below 0 is found within the step. All modes with a margin below 0 then change together, `enter` may set
 * states that a mode holds, and this is repeated until no margin is below 0. Within modes, MODEL_LINEAR counts.
 * s->name.lasts is 1 where the margin follows from inputs, parameters and modes alone: then it is looked at between steps
 * only, and while all modes last, a step costs what it costs without modes.
 * s->name.linear and s->name.most may tell a margin that is linear in the states, so that steps far from its end cost
 * little: linear changes with the states at rates that modes and parameters alone determine, whatever the states, and the
 * margin, where it is not below 0, is linear, most being INFINITY, or most - |linear|. Left out, most is 0: nothing is told.
 *
 * From the table come the structures below, the value references (a variable's place in the table) and
 * modelDescription.xml.
 */
#ifndef MODEL_H
#define MODEL_H

#ifndef MODEL_LINEAR
#error "before model.h is included, MODEL_LINEAR must be defined, as 1 or 0"
#endif
#ifndef MODEL_VARIABLES
#error "before model.h is included, MODEL_VARIABLES must be defined: the table"
#endif

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* What is within the brackets, for variables of one kind only. */
#define MODEL_STATE_input(...)
#define MODEL_STATE_parameter(...)
#define MODEL_STATE_state(...) __VA_ARGS__
#define MODEL_STATE_output(...)
#define MODEL_STATE_mode(...)
#define MODEL_OUTPUT_input(...)
#define MODEL_OUTPUT_parameter(...)
#define MODEL_OUTPUT_state(...)
#define MODEL_OUTPUT_output(...) __VA_ARGS__
#define MODEL_OUTPUT_mode(...)
#define MODEL_MODE_input(...)
#define MODEL_MODE_parameter(...)
#define MODEL_MODE_state(...)
#define MODEL_MODE_output(...)
#define MODEL_MODE_mode(...) __VA_ARGS__

#define MODEL_MEMBER(kind, name, start, nominal, min, max, unit, text) double name;
#define MODEL_STATE_MEMBER(kind, name, start, nominal, min, max, unit, text) MODEL_STATE_##kind(double name;)
#define MODEL_OUTPUT_MEMBER(kind, name, start, nominal, min, max, unit, text) MODEL_OUTPUT_##kind(double name;)
#define MODEL_MODE_MEMBER(kind, name, start, nominal, min, max, unit, text) MODEL_MODE_##kind(Switch name;)

#define MODEL_ONE(kind, name, start, nominal, min, max, unit, text) +1
#define MODEL_STATE_ONE(kind, name, start, nominal, min, max, unit, text) MODEL_STATE_##kind(+1)
#define MODEL_OUTPUT_ONE(kind, name, start, nominal, min, max, unit, text) MODEL_OUTPUT_##kind(+1)
#define MODEL_MODE_ONE(kind, name, start, nominal, min, max, unit, text) MODEL_MODE_##kind(+1)
#define MODEL_MODES (0 MODEL_VARIABLES(MODEL_MODE_ONE)) /* their number, for the preprocessor too */

/* The values, in the order of the table. */
typedef struct {
    MODEL_VARIABLES(MODEL_MEMBER)
} Variables;

/* The derivatives of the states, then the values of the calculated outputs. */
typedef struct {
    MODEL_VARIABLES(MODEL_STATE_MEMBER)
    MODEL_VARIABLES(MODEL_OUTPUT_MEMBER)
} Derivatives;

static void derivatives(const Variables *m, Derivatives *d);

/* How far a mode is from its end, the one that follows, whether (1) or not (0) no state can end it, and what it is made of. */
typedef struct {
    double margin, next, lasts, linear, most;
} Switch;

#if MODEL_MODES > 0
typedef struct {
    MODEL_VARIABLES(MODEL_MODE_MEMBER)
} Switches;

static void switches(const Variables *m, Switches *s);
static void enter(Variables *m);

/* One that no state can end. */
static inline Switch lasting_switch(double margin, double next)
{
    return (Switch){margin, next, 1, 0, 0};
}

/* One whose margin is linear in the states. */
static inline Switch linear_switch(double margin, double next)
{
    return (Switch){margin, next, 0, margin, INFINITY};
}

#define UNHELD 2 /* a mode: free either way */

/* Dry friction on a rate x: it moves one way, 1, or the other, -1, or is held at 0, mode 0, while what drives it, push,
   is no more than hold. Where hold is 0 it is UNHELD: its zeros are no events. */
static inline Switch dry_friction(double mode, double x, double push, double hold)
{
    if (hold == 0) return lasting_switch(mode == UNHELD ? 1 : -1, UNHELD);
    if (mode == UNHELD) return lasting_switch(-1, x > 0 ? 1 : x < 0 ? -1 : 0);
    if (mode != 0) return linear_switch(mode * x, 0);
    if (x != 0) return (Switch){-fabs(x), x > 0 ? 1 : -1, 0, push, hold}; /* it was set to move */
    return (Switch){hold - fabs(push), push > 0 ? 1 : -1, 0, push, hold};
}
#endif

/* From here on: the same by number, for the code around the model. */

enum {
    N_VARIABLES = MODEL_VARIABLES(MODEL_ONE),
    N_STATES = 0 MODEL_VARIABLES(MODEL_STATE_ONE),
    N_OUTPUTS = 0 MODEL_VARIABLES(MODEL_OUTPUT_ONE), /* the calculated ones */
    N_MODES = MODEL_MODES
};

typedef union {
    Variables named;
    double flat[N_VARIABLES + 1]; /* by value reference; after them, the time */
} Values;

typedef union {
    Derivatives named;
    double flat[N_STATES + N_OUTPUTS];
} Rates;

typedef union {
#if MODEL_MODES > 0
    Switches named;
#endif
    Switch flat[N_MODES + 1];
} Margins;

_Static_assert(N_STATES > 0, "a model has a state");
_Static_assert(sizeof(Variables) == N_VARIABLES * sizeof(double), "the values lie side by side");

typedef enum { MODEL_input, MODEL_parameter, MODEL_state, MODEL_output, MODEL_mode } Kind;

typedef struct {
    Kind kind;
    const char *name;
    double start, nominal, min, max;
    const char *unit, *description;
} TableRow;

#define MODEL_ROW(kind, name, start, nominal, min, max, unit, text) \
    {MODEL_##kind, #name, start, nominal, min, max, unit, text},
#define MODEL_PLACE(name) (int)(offsetof(Variables, name) / sizeof(double))
#define MODEL_STATE_PLACE(kind, name, start, nominal, min, max, unit, text) MODEL_STATE_##kind(MODEL_PLACE(name), )
#define MODEL_OUTPUT_PLACE(kind, name, start, nominal, min, max, unit, text) MODEL_OUTPUT_##kind(MODEL_PLACE(name), )
#define MODEL_MODE_PLACE(kind, name, start, nominal, min, max, unit, text) MODEL_MODE_##kind(MODEL_PLACE(name), )

static const TableRow model_table[N_VARIABLES] = {MODEL_VARIABLES(MODEL_ROW)};
static const int model_state_places[] = {MODEL_VARIABLES(MODEL_STATE_PLACE)};
static const int model_output_places[N_OUTPUTS + 1] = {MODEL_VARIABLES(MODEL_OUTPUT_PLACE) -1};
static const int model_mode_places[N_MODES + 1] = {MODEL_VARIABLES(MODEL_MODE_PLACE) -1};

#endif
