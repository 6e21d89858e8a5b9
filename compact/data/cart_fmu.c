/* Co-simulation unit (FMI 2.0) of a cart of compact: resistance F(v, a), guide friction and drive force of a prescribed
   motion, and the motion under a prescribed force. Self-contained; cart_data.h holds the numbers of one scene.

   Resistance: cubic splines of F and M over ln|v|, a power law below the slowest sample, the added-mass term held at
   its limit, as `compact.resistance.ResistanceMap`. Guide friction: `compact.machine.cart.balance` with a drive along
   the rails. After a turn both are multiplied by shares over the travel, as in `compact.turning`: each motion, prescribed
   and free, remembers front and origin in both headings. The prescribed position is integrated from velocity and
   acceleration. Motion: classical Runge-Kutta steps of at most MAX_STEP; one in which the velocity changes its sign is
   split there. */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cart_data.h"

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define MAX_STEP 1e-3       /* [s] */
#define BISECTIONS 80       /* [-], of the acceleration; the bracket shrinks below rounding */
#define SPEED_ROUNDING 1e-9 /* [-], by which a speed may exceed the fastest sample */

typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

enum { VELOCITY, ACCELERATION, APPLIED_FORCE, START_POSITION, START_VELOCITY, INPUTS,
       RESISTANCE = INPUTS, GUIDE_FRICTION, DRIVE_FORCE, CART_POSITION, CART_VELOCITY, CART_ACCELERATION, TRAVEL,
       VARIABLES };

/* Places in the sense of each heading, forward and backward; amounts that the release takes from force and load. */
typedef struct { double front[2], origin[2], turn, released[2]; int heading; } Memory;

typedef struct {
    double inputs[INPUTS], position, velocity, prescribed;
    Memory memory, prescribed_memory;
    char name[128];
    const fmi2CallbackFunctions *callbacks;
} Cart;

typedef struct { double resistance, friction; } Forces;

static double sign(double x) { return (x > 0) - (x < 0); }

static double cubic(const double c[4], double x) { return ((c[0] * x + c[1]) * x + c[2]) * x + c[3]; }

static double resistance(double v, double a) {
    double speed = fabs(v), slowest = exp(BREAKS[0]), x = log(fmax(speed, slowest)), force, limit;
    int piece = 0;
    while (piece < PIECES - 1 && x >= BREAKS[piece + 1]) piece++;
    x = fmin(x, BREAKS[PIECES]) - BREAKS[piece];
    force = cubic(FORCE[piece], x);
    if (EXPONENT != 0 && speed < slowest) force *= pow(speed / slowest, EXPONENT);
    limit = RATE_LIMIT * speed;
    if (RATE_LIMIT > 0) a = fmax(-limit, fmin(limit, a));
    return (v < 0 ? RETURN_RATIO : 1.0) * (sign(v) * force + a * cubic(MASS[piece], x));
}

/* Share of the force (k = 0) or the load (k = 1) over the abscissa [m] of its table. */
static double share_table(int row, int k, double s) {
    int i = FIRSTS[2 * row + k], end = FIRSTS[2 * row + k + 1];
    double u, value = 0;
    while (i < end - 1 && s >= SHARES[i + 1][0]) i++;
    u = fmax(0, fmin(1, (s - SHARES[i][0]) / SHARES[i][1]));
    for (int j = SHARE_COLUMNS - 1; j > 1; j--) value = value * u + SHARES[i][j];
    return value;
}

static double first_part(const Memory *m, int row, int k, double place) {
    double reached = fmax(place, m->front[row]), value = share_table(row, k, reached - m->origin[row]);
    if (place >= m->front[row]) return value;
    if (RELEASES[row] == 0) return TRACKS[row][k];
    return TRACKS[row][k] + (value - TRACKS[row][k]) * exp((place - m->front[row]) / RELEASES[row]);
}

static double share(const Memory *m, int k, double x) {
    int row = m->heading < 0;
    double s = m->heading * (x - m->turn), first;
    if (!TURNS) return 1;
    first = first_part(m, row, k, m->heading * x);
    return m->released[k] == 0 ? first : first - m->released[k] * exp(-s / RELEASES[row]);
}

/* Memory after a turn at a position [m]. */
static Memory turned(const Memory *before, double x) {
    Memory m = *before;
    int old = m.heading < 0, row = 1 - old;
    m.heading = -m.heading, m.turn = x;
    m.front[old] = fmax(m.front[old], before->heading * x);
    if (m.front[row] - m.heading * x > DISTANCES[row]) { /* the sleeve has laid fresh mix */
        m.front[row] = m.heading * x + DISTANCES[row];
        m.origin[row] = m.heading * x;
    }
    for (int k = 0; k < 2; k++) { /* neither force nor load jumps */
        double ratio = k ? RETURN_LOAD_RATIO : FORCE_RATIO, last = share(before, k, x);
        if (ratio > 0) last *= m.heading > 0 ? ratio : 1 / ratio;
        m.released[k] = RELEASES[row] == 0 ? 0 : first_part(&m, row, k, m.heading * x) + (k ? -last : last);
    }
    return m;
}

static void turn(Memory *m, double way, double x) { if (way * m->heading < 0) *m = turned(m, x); }

/* Memory of a cart that came from the far end, at a position [m]. */
static Memory initial(double x) {
    Memory m = {{STROKE, -x}, {0, -STROKE}, STROKE, {0, 0}, -1};
    return m;
}

static Forces forces(double v, double a, Memory m, double x) {
    Forces found = {0, 0};
    double s = sign(v), ratio = s < 0 ? RETURN_LOAD_RATIO : 1.0, lift;
    turn(&m, v, x);
    found.resistance = share(&m, 0, x) * resistance(v, a);
    ratio *= share(&m, 1, x);
    lift = ratio * LIFT - WEIGHT;
    double moment = ratio * LIFT_MOMENT - found.resistance * ARM + s * GUIDE_FRICTION_COEFFICIENT * WHEEL_RADIUS * lift;
    double front = (moment - REAR * lift) / (FRONT - REAR), rear = (FRONT * lift - moment) / (FRONT - REAR);
    found.friction = s * GUIDE_FRICTION_COEFFICIENT * (fabs(front) + fabs(rear));
    return found;
}

/* Acceleration [m/s^2] of a moving cart: m a + F(v, a) + friction = force, increasing in a. */
static double acceleration(double v, double force, const Memory *m, double x) {
    Forces rest = forces(v, 0, *m, x);
    double low, high, width = fabs((force - rest.resistance - rest.friction) / CART_MASS) + 1e-12;
    low = high = (force - rest.resistance - rest.friction) / CART_MASS;
    for (int k = 0; k < BISECTIONS; k++, width *= 2) {
        Forces at_low = forces(v, low - width, *m, x), at_high = forces(v, high + width, *m, x);
        if (CART_MASS * (low - width) + at_low.resistance + at_low.friction <= force &&
            CART_MASS * (high + width) + at_high.resistance + at_high.friction >= force) break;
    }
    low -= width, high += width;
    for (int k = 0; k < BISECTIONS && high - low > 1e-15 * fabs(high); k++) {
        double middle = (low + high) / 2;
        Forces found = forces(v, middle, *m, x);
        if (CART_MASS * middle + found.resistance + found.friction < force) low = middle; else high = middle;
    }
    return (low + high) / 2;
}

/* Acceleration of the cart at any velocity; a cart at rest sticks until the force exceeds the resistance. */
static double cart_acceleration(double v, double force, const Memory *m, double x) {
    double tiny = 1e-12 * exp(BREAKS[0]), up, down;
    if (v != 0) return acceleration(v, force, m, x);
    up = acceleration(tiny, force, m, x);
    down = acceleration(-tiny, force, m, x);
    return up > 0 ? up : down < 0 ? down : 0;
}

/* One Runge-Kutta step [s]; returns the time that is left where the cart comes to rest within it. */
static double step(Cart *cart, double h) {
    double force = cart->inputs[APPLIED_FORCE], x = cart->position, v = cart->velocity;
    const Memory *m = &cart->memory;
    double a1 = cart_acceleration(v, force, m, x), v2 = v + h / 2 * a1, v3, v4, a2, a3, a4, after;
    turn(&cart->memory, v != 0 ? v : a1, x);
    a2 = v2 * v < 0 ? a1 : cart_acceleration(v2, force, m, x + h / 2 * v), v3 = v + h / 2 * a2;
    a3 = v3 * v < 0 ? a1 : cart_acceleration(v3, force, m, x + h / 2 * v2), v4 = v + h * a3;
    a4 = v4 * v < 0 ? a1 : cart_acceleration(v4, force, m, x + h * v3);
    after = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
    if (v * after < 0) {
        double braking = h * v / (v - after);
        cart->position = x + v * braking / 2;
        cart->velocity = 0;
        return h - braking;
    }
    if (v != 0 || a1 * after >= 0) { /* a cart at rest leaves it in the direction of its acceleration only */
        cart->position = x + h / 6 * (v + 2 * v2 + 2 * v3 + v4);
        cart->velocity = after;
    }
    return 0;
}

/* Follow the prescribed motion over a time [s]. */
static void follow(Cart *cart, double duration) {
    double v = cart->inputs[VELOCITY], a = cart->inputs[ACCELERATION];
    double stop = v * a < 0 && -v / a < duration ? -v / a : duration, left = duration - stop;
    turn(&cart->prescribed_memory, v != 0 ? v : a, cart->prescribed);
    cart->prescribed += v * stop + a / 2 * stop * stop;
    if (left > 0) {
        turn(&cart->prescribed_memory, a, cart->prescribed);
        cart->prescribed += a / 2 * left * left;
    }
}

static void advance(Cart *cart, double duration) {
    int steps = (int)ceil(duration / MAX_STEP - 1e-9);
    for (int k = 0; k < steps; k++)
        for (double left = duration / steps; left > 0;) left = step(cart, left); /* twice at most: from rest all of it */
}

static int within_samples(Cart *cart, double v) {
    if (fabs(v) <= FASTEST * (1 + SPEED_ROUNDING)) return 1;
    if (cart->callbacks && cart->callbacks->logger)
        cart->callbacks->logger(cart->callbacks->componentEnvironment, cart->name, fmi2Error, "logStatusError",
            "the resistance was computed up to %g m/s, got %g m/s; export it over a faster motion", FASTEST, fabs(v));
    return 0;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
    (void)c, (void)on, (void)n, (void)names;
    return fmi2OK;
}

EXPORT fmi2Component fmi2Instantiate(fmi2String name, int type, fmi2String guid, fmi2String place,
                                     const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    Cart *cart;
    (void)place, (void)visible, (void)logging;
    if (type != 1 || strcmp(guid, GUID) != 0) return NULL; /* co-simulation of this very unit */
    cart = calloc(1, sizeof(Cart));
    if (!cart) return NULL;
    if (name) strncpy(cart->name, name, sizeof(cart->name) - 1);
    cart->callbacks = callbacks;
    return cart;
}

EXPORT void fmi2FreeInstance(fmi2Component c) { free(c); }

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean hasTolerance, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean hasStop, fmi2Real stop) {
    (void)c, (void)hasTolerance, (void)tolerance, (void)start, (void)hasStop, (void)stop;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Cart *cart = c;
    cart->position = cart->inputs[START_POSITION];
    cart->velocity = cart->inputs[START_VELOCITY];
    cart->prescribed = cart->position;
    cart->memory = cart->prescribed_memory = initial(cart->position);
    return within_samples(cart, cart->velocity) ? fmi2OK : fmi2Error;
}

EXPORT fmi2Status fmi2Terminate(fmi2Component c) { (void)c; return fmi2OK; }

EXPORT fmi2Status fmi2Reset(fmi2Component c) {
    Cart *cart = c;
    memset(cart->inputs, 0, sizeof(cart->inputs));
    cart->position = cart->velocity = cart->prescribed = 0;
    cart->memory = cart->prescribed_memory = initial(0);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    Cart *cart = c;
    double v = cart->inputs[VELOCITY], a = cart->inputs[ACCELERATION];
    Memory memory;
    Forces found;
    if (!within_samples(cart, v)) return fmi2Error;
    memory = cart->prescribed_memory;
    turn(&memory, v, cart->prescribed);
    found = forces(v, a, memory, cart->prescribed);
    for (size_t k = 0; k < n; k++) {
        switch (vr[k]) {
        case RESISTANCE: value[k] = found.resistance; break;
        case GUIDE_FRICTION: value[k] = found.friction; break;
        case DRIVE_FORCE: value[k] = CART_MASS * a + found.resistance + found.friction; break;
        case CART_POSITION: value[k] = cart->position; break;
        case CART_VELOCITY: value[k] = cart->velocity; break;
        case CART_ACCELERATION: value[k] = cart_acceleration(cart->velocity, cart->inputs[APPLIED_FORCE], &cart->memory, cart->position); break;
        case TRAVEL: value[k] = fabs(cart->prescribed - memory.turn); break;
        default:
            if (vr[k] >= INPUTS) return fmi2Error;
            value[k] = cart->inputs[vr[k]];
        }
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    for (size_t k = 0; k < n; k++) {
        if (vr[k] >= INPUTS) return fmi2Error;
        ((Cart *)c)->inputs[vr[k]] = value[k];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real step, fmi2Boolean noSetPrior) {
    (void)now, (void)noSetPrior;
    follow(c, step);
    advance(c, step);
    return within_samples(c, ((Cart *)c)->velocity) ? fmi2OK : fmi2Error;
}

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!*state && !(*state = malloc(sizeof(Cart)))) return fmi2Error;
    memcpy(*state, c, sizeof(Cart));
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    memcpy(c, state, sizeof(Cart));
    return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

/* Functions of the standard that this unit does not need: no variables but reals, no derivatives, no interruption. */
#define NOT_USED(name, ...) EXPORT fmi2Status name(fmi2Component c, __VA_ARGS__) { (void)c; return fmi2Error; }
#define VECTOR const fmi2ValueReference *vr, size_t n

NOT_USED(fmi2GetInteger, VECTOR, fmi2Integer *value)
NOT_USED(fmi2GetBoolean, VECTOR, fmi2Boolean *value)
NOT_USED(fmi2GetString, VECTOR, fmi2String *value)
NOT_USED(fmi2SetInteger, VECTOR, const fmi2Integer *value)
NOT_USED(fmi2SetBoolean, VECTOR, const fmi2Boolean *value)
NOT_USED(fmi2SetString, VECTOR, const fmi2String *value)
NOT_USED(fmi2SerializedFMUstateSize, fmi2FMUstate state, size_t *size)
NOT_USED(fmi2SerializeFMUstate, fmi2FMUstate state, fmi2Byte *bytes, size_t size)
NOT_USED(fmi2DeSerializeFMUstate, const fmi2Byte *bytes, size_t size, fmi2FMUstate *state)
NOT_USED(fmi2GetDirectionalDerivative, const fmi2ValueReference *unknown, size_t unknowns,
         const fmi2ValueReference *known, size_t knowns, const fmi2Real *given, fmi2Real *value)
NOT_USED(fmi2SetRealInputDerivatives, VECTOR, const fmi2Integer *order, const fmi2Real *value)
NOT_USED(fmi2GetRealOutputDerivatives, VECTOR, const fmi2Integer *order, fmi2Real *value)
NOT_USED(fmi2GetStatus, int kind, fmi2Status *value)
NOT_USED(fmi2GetRealStatus, int kind, fmi2Real *value)
NOT_USED(fmi2GetIntegerStatus, int kind, fmi2Integer *value)
NOT_USED(fmi2GetBooleanStatus, int kind, fmi2Boolean *value)
NOT_USED(fmi2GetStringStatus, int kind, fmi2String *value)
EXPORT fmi2Status fmi2CancelStep(fmi2Component c) { (void)c; return fmi2Error; }
