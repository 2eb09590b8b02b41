/* A linear body x' = A x + B u, y = C x + D u as a functional mock-up unit, FMI 2.0 and 3.0.

   Written by flexgram beside model_data.h, which holds the matrices. A step of co-simulation is
   exact for inputs that are linear over it (constant, if nobody tells their slope): the exponential
   of [[A, B, 0], [0, 0, I/h], [0, 0, 0]] h, kept until h changes. Model exchange has the 2m states
   themselves. Functions and types by the FMI standard (fmi-standard.org), versions 2.0.5 and 3.0.2. */

#include "model_data.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { OK = 0, WARNING = 1, DISCARD = 2, FAILED = 3 };

/* Value references: inputs, outputs, states, their derivatives, the damping's factor, the body's own
   parameters (NP of them), time. */
enum {
  FIRST_OUTPUT = NU,
  FIRST_STATE = FIRST_OUTPUT + NY,
  FIRST_RATE = FIRST_STATE + NX,
  DAMPING = FIRST_RATE + NX,
  FIRST_PARAMETER = DAMPING + 1,
  TIME = FIRST_PARAMETER + NP,
  COUNT = TIME + 1
};

typedef struct {
  double time, damping, step; /* step: of Phi and G, 0: none */
  double x[NX], u[NU], slope[NU];
#if NP
  double p[NP];
#endif
} State;

typedef struct {
  State s;
  double *Phi, *G0, *G1; /* x+ = Phi x + G0 u + G1 (u+ - u) */
} Body;

static double power(double x, int n) {
  double y = 1;
  while (n-- > 0) y *= x;
  return y;
}

/* What an entry of A0 + damping A1, or C0 + damping C1, gains by values of the parameters that are
   not the present ones. */
static double gained(const Body *b, const double *of_0, const double *of_1, int size, int at) {
  double sum = 0;
#if NP
  for (int k = 0; k < NG; ++k) {
    const int p = GAIN_OF[k], n = GAIN_POWER[k];
    const double factor = power(b->s.p[p], n) - power(PRESENT[p], n);
    if (factor != 0)
      sum += factor * (of_0[k * size + at] + b->s.damping * of_1[k * size + at]);
  }
#else
  (void)b, (void)of_0, (void)of_1, (void)size, (void)at, (void)power;
#endif
  return sum;
}

/* A of the damping's factor: A0 + damping A1. */
static double rate_matrix(const Body *b, int i, int j) {
  return A0[i * NX + j] + b->s.damping * A1[i * NX + j] +
         gained(b, GAIN_A0, GAIN_A1, NX * NX, i * NX + j);
}

static void rates(const Body *b, double *dx) {
  for (int i = 0; i < NX; ++i) {
    double sum = 0;
    for (int j = 0; j < NX; ++j) sum += rate_matrix(b, i, j) * b->s.x[j];
    for (int j = 0; j < NU; ++j) sum += B[i * NU + j] * b->s.u[j];
    dx[i] = sum;
  }
}

/* C1 holds what damping adds: of accelerations by A, of reactions by their own damping. */
static double output(const Body *b, int i) {
  double sum = 0;
  for (int j = 0; j < NX; ++j)
    sum += (C0[i * NX + j] + b->s.damping * C1[i * NX + j] +
            gained(b, GAIN_C0, GAIN_C1, NY * NX, i * NX + j)) *
           b->s.x[j];
  for (int j = 0; j < NU; ++j) sum += D[i * NU + j] * b->s.u[j];
  return sum;
}

static void multiply(int n, const double *a, const double *b, double *c) {
  memset(c, 0, sizeof(double) * (size_t)n * (size_t)n);
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < n; ++k) {
      const double f = a[i * n + k];
      if (f != 0)
        for (int j = 0; j < n; ++j) c[i * n + j] += f * b[k * n + j];
    }
}

/* Scaling and squaring of Taylor's series of degree 16 where the norm is at most a half. */
static bool prepare(Body *b, double h) {
  if (b->Phi && fabs(h - b->s.step) <= 1e-13 * fabs(h)) return true;
  enum { n = NX + 2 * NU };
  const size_t size = sizeof(double) * n * n;
  double *M = calloc(1, size), *T = calloc(1, size), *W = calloc(1, size);
  if (!b->Phi) b->Phi = malloc(sizeof(double) * NX * NX);
  if (!b->G0) b->G0 = malloc(sizeof(double) * NX * NU);
  if (!b->G1) b->G1 = malloc(sizeof(double) * NX * NU);
  const bool good = M && T && W && b->Phi && b->G0 && b->G1;
  if (good) {
    double norm = 0;
    for (int i = 0; i < NX; ++i) {
      for (int j = 0; j < NX; ++j) M[i * n + j] = h * rate_matrix(b, i, j);
      for (int j = 0; j < NU; ++j) M[i * n + NX + j] = h * B[i * NU + j];
    }
    for (int j = 0; j < NU; ++j) M[(NX + j) * n + NX + NU + j] = 1;
    for (int i = 0; i < n; ++i) {
      double sum = 0;
      for (int j = 0; j < n; ++j) sum += fabs(M[i * n + j]);
      norm = fmax(norm, sum);
    }
    int halvings = 0;
    while (norm > 0.5) {
      norm /= 2;
      ++halvings;
    }
    for (int i = 0; i < n * n; ++i) M[i] = ldexp(M[i], -halvings);
    for (int i = 0; i < n; ++i) T[i * n + i] = 1; /* Horner's rule */
    for (int k = 16; k > 0; --k) {
      multiply(n, M, T, W);
      for (int i = 0; i < n * n; ++i) T[i] = W[i] / k;
      for (int i = 0; i < n; ++i) T[i * n + i] += 1;
    }
    for (; halvings > 0; --halvings) {
      multiply(n, T, T, W);
      memcpy(T, W, size);
    }
    for (int i = 0; i < NX; ++i) {
      memcpy(b->Phi + i * NX, T + i * n, sizeof(double) * NX);
      memcpy(b->G0 + i * NU, T + i * n + NX, sizeof(double) * NU);
      memcpy(b->G1 + i * NU, T + i * n + NX + NU, sizeof(double) * NU);
    }
    b->s.step = h;
  }
  free(M);
  free(T);
  free(W);
  return good;
}

static int step(Body *b, double h) {
  if (!(h >= 0) || !isfinite(h)) return FAILED;
  if (h == 0) return OK;
  if (!prepare(b, h)) return FAILED;
  double next[NX];
  for (int i = 0; i < NX; ++i) {
    double sum = 0;
    for (int j = 0; j < NX; ++j) sum += b->Phi[i * NX + j] * b->s.x[j];
    for (int j = 0; j < NU; ++j)
      sum += b->G0[i * NU + j] * b->s.u[j] + b->G1[i * NU + j] * h * b->s.slope[j];
    next[i] = sum;
  }
  memcpy(b->s.x, next, sizeof next);
  for (int j = 0; j < NU; ++j) {
    b->s.u[j] += h * b->s.slope[j];
    b->s.slope[j] = 0; /* until it is told again */
  }
  b->s.time += h;
  return OK;
}

static void reset(Body *b) {
  memset(&b->s, 0, sizeof b->s);
  b->s.damping = 1;
#if NP
  memcpy(b->s.p, PRESENT, sizeof b->s.p);
#endif
  b->s.step = -1;
}

static Body *create(void) {
  Body *b = calloc(1, sizeof *b);
  if (b) reset(b);
  return b;
}

static void destroy(Body *b) {
  if (!b) return;
  free(b->Phi);
  free(b->G0);
  free(b->G1);
  free(b);
}

static int get(const Body *b, const uint32_t *which, size_t count, double *value) {
  double dx[NX];
  bool known = false;
  for (size_t k = 0; k < count; ++k) {
    const uint32_t v = which[k];
    if (v >= COUNT) return FAILED;
    if (v >= FIRST_RATE && v < DAMPING && !known) {
      rates(b, dx);
      known = true;
    }
    value[k] = v < FIRST_OUTPUT  ? b->s.u[v]
               : v < FIRST_STATE ? output(b, (int)(v - FIRST_OUTPUT))
               : v < FIRST_RATE  ? b->s.x[v - FIRST_STATE]
               : v < DAMPING     ? dx[v - FIRST_RATE]
               : v == DAMPING    ? b->s.damping
#if NP
               : v < TIME        ? b->s.p[v - FIRST_PARAMETER]
#endif
                                 : b->s.time;
  }
  return OK;
}

static int set(Body *b, const uint32_t *which, size_t count, const double *value) {
  for (size_t k = 0; k < count; ++k) {
    const uint32_t v = which[k];
    if (v < FIRST_OUTPUT)
      b->s.u[v] = value[k];
    else if (v >= FIRST_STATE && v < FIRST_RATE)
      b->s.x[v - FIRST_STATE] = value[k];
    else if (v == DAMPING && value[k] >= 0) {
      b->s.damping = value[k];
      b->s.step = -1;
#if NP
    } else if (v >= FIRST_PARAMETER && v < TIME && value[k] >= LEAST[v - FIRST_PARAMETER] &&
               value[k] <= MOST[v - FIRST_PARAMETER]) {
      b->s.p[v - FIRST_PARAMETER] = value[k];
      b->s.step = -1;
#endif
    } else
      return FAILED;
  }
  return OK;
}

#if FMI == 2 /* 3.0 has no slopes of inputs */
static int set_slopes(Body *b, const uint32_t *which, size_t count, const int32_t *order,
                      const double *value) {
  for (size_t k = 0; k < count; ++k) {
    if (which[k] >= FIRST_OUTPUT || order[k] != 1) return FAILED;
    b->s.slope[which[k]] = value[k];
  }
  return OK;
}

#endif

static int keep(const Body *b, void **kept) {
  if (!*kept) *kept = malloc(sizeof(State));
  if (!*kept) return FAILED;
  memcpy(*kept, &b->s, sizeof(State));
  return OK;
}

static int restore(Body *b, const void *kept) {
  const State before = b->s;
  memcpy(&b->s, kept, sizeof(State));
  bool same = b->Phi && b->s.damping == before.damping; /* what Phi is of */
#if NP
  same = same && memcmp(b->s.p, before.p, sizeof before.p) == 0;
#endif
  b->s.step = same ? before.step : -1;
  return OK;
}

static int forget(void **kept) {
  free(*kept);
  *kept = NULL;
  return OK;
}

#if FMI == 2

typedef void *fmi2Component;
typedef struct {
  int newDiscreteStatesNeeded, terminateSimulation, nominalsOfContinuousStatesChanged,
      valuesOfContinuousStatesChanged, nextEventTimeDefined;
  double nextEventTime;
} fmi2EventInfo;

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT int fmi2SetDebugLogging(fmi2Component c, int on, size_t n, const char *const names[]) {
  (void)c, (void)on, (void)n, (void)names;
  return OK;
}
EXPORT fmi2Component fmi2Instantiate(const char *name, int type, const char *guid,
                                     const char *resources, const void *callbacks, int visible,
                                     int logging) {
  (void)name, (void)type, (void)resources, (void)callbacks, (void)visible, (void)logging;
  return guid && strcmp(guid, TOKEN) == 0 ? create() : NULL;
}
EXPORT void fmi2FreeInstance(fmi2Component c) { destroy(c); }
EXPORT int fmi2SetupExperiment(fmi2Component c, int defined, double tolerance, double start,
                               int ends, double stop) {
  (void)defined, (void)tolerance, (void)ends, (void)stop;
  ((Body *)c)->s.time = start;
  return OK;
}
EXPORT int fmi2EnterInitializationMode(fmi2Component c) { return (void)c, OK; }
EXPORT int fmi2ExitInitializationMode(fmi2Component c) { return (void)c, OK; }
EXPORT int fmi2Terminate(fmi2Component c) { return (void)c, OK; }
EXPORT int fmi2Reset(fmi2Component c) { return reset(c), OK; }
EXPORT int fmi2GetReal(fmi2Component c, const uint32_t v[], size_t n, double value[]) {
  return get(c, v, n, value);
}
EXPORT int fmi2SetReal(fmi2Component c, const uint32_t v[], size_t n, const double value[]) {
  return set(c, v, n, value);
}
#define NONE(name, type)                                                                   \
  EXPORT int name(fmi2Component c, const uint32_t v[], size_t n, type value[]) {           \
    return (void)c, (void)v, (void)value, n ? FAILED : OK;                                 \
  }
NONE(fmi2GetInteger, int)
NONE(fmi2GetBoolean, int)
NONE(fmi2GetString, const char *)
NONE(fmi2SetInteger, const int)
NONE(fmi2SetBoolean, const int)
NONE(fmi2SetString, const char *const)
EXPORT int fmi2GetFMUstate(fmi2Component c, void **kept) { return keep(c, kept); }
EXPORT int fmi2SetFMUstate(fmi2Component c, void *kept) { return restore(c, kept); }
EXPORT int fmi2FreeFMUstate(fmi2Component c, void **kept) { return (void)c, forget(kept); }
EXPORT int fmi2SerializedFMUstateSize(fmi2Component c, void *kept, size_t *size) {
  return (void)c, (void)kept, *size = sizeof(State), OK;
}
EXPORT int fmi2SerializeFMUstate(fmi2Component c, void *kept, char bytes[], size_t size) {
  (void)c;
  return size < sizeof(State) ? FAILED : (memcpy(bytes, kept, sizeof(State)), OK);
}
EXPORT int fmi2DeSerializeFMUstate(fmi2Component c, const char bytes[], size_t size,
                                   void **kept) {
  if (size < sizeof(State) || keep(c, kept) != OK) return FAILED;
  memcpy(*kept, bytes, sizeof(State));
  return OK;
}
EXPORT int fmi2GetDirectionalDerivative(fmi2Component c, const uint32_t a[], size_t n,
                                        const uint32_t b[], size_t k, const double x[],
                                        double y[]) {
  (void)c, (void)a, (void)n, (void)b, (void)k, (void)x, (void)y;
  return FAILED;
}
EXPORT int fmi2EnterEventMode(fmi2Component c) { return (void)c, OK; }
EXPORT int fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
  (void)c;
  memset(info, 0, sizeof *info);
  return OK;
}
EXPORT int fmi2EnterContinuousTimeMode(fmi2Component c) { return (void)c, OK; }
EXPORT int fmi2CompletedIntegratorStep(fmi2Component c, int kept, int *event, int *end) {
  return (void)c, (void)kept, *event = *end = 0, OK;
}
EXPORT int fmi2SetTime(fmi2Component c, double time) {
  ((Body *)c)->s.time = time;
  return OK;
}
EXPORT int fmi2SetContinuousStates(fmi2Component c, const double x[], size_t n) {
  if (n != NX) return FAILED;
  memcpy(((Body *)c)->s.x, x, sizeof(double) * NX);
  return OK;
}
EXPORT int fmi2GetDerivatives(fmi2Component c, double dx[], size_t n) {
  return n == NX ? (rates(c, dx), OK) : FAILED;
}
EXPORT int fmi2GetEventIndicators(fmi2Component c, double e[], size_t n) {
  return (void)c, (void)e, n ? FAILED : OK;
}
EXPORT int fmi2GetContinuousStates(fmi2Component c, double x[], size_t n) {
  if (n != NX) return FAILED;
  memcpy(x, ((Body *)c)->s.x, sizeof(double) * NX);
  return OK;
}
EXPORT int fmi2GetNominalsOfContinuousStates(fmi2Component c, double x[], size_t n) {
  (void)c;
  for (size_t i = 0; i < n; ++i) x[i] = 1;
  return OK;
}
EXPORT int fmi2SetRealInputDerivatives(fmi2Component c, const uint32_t v[], size_t n,
                                       const int order[], const double value[]) {
  return set_slopes(c, v, n, order, value);
}
EXPORT int fmi2GetRealOutputDerivatives(fmi2Component c, const uint32_t v[], size_t n,
                                        const int order[], double value[]) {
  return (void)c, (void)v, (void)order, (void)value, n ? FAILED : OK;
}
EXPORT int fmi2DoStep(fmi2Component c, double time, double h, int no_return) {
  (void)no_return;
  ((Body *)c)->s.time = time;
  return step(c, h);
}
EXPORT int fmi2CancelStep(fmi2Component c) { return (void)c, FAILED; }
#define STATUS(name, type)                                                                 \
  EXPORT int name(fmi2Component c, int kind, type *value) {                                \
    return (void)c, (void)kind, (void)value, DISCARD;                                      \
  }
STATUS(fmi2GetStatus, int)
STATUS(fmi2GetRealStatus, double)
STATUS(fmi2GetIntegerStatus, int)
STATUS(fmi2GetBooleanStatus, int)
STATUS(fmi2GetStringStatus, const char *)

#else /* FMI 3.0 */

typedef void *fmi3Instance;

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT int fmi3SetDebugLogging(fmi3Instance c, bool on, size_t n, const char *const names[]) {
  return (void)c, (void)on, (void)n, (void)names, OK;
}
static fmi3Instance instance(const char *token) {
  return token && strcmp(token, TOKEN) == 0 ? create() : NULL;
}
EXPORT fmi3Instance fmi3InstantiateModelExchange(const char *name, const char *token,
                                                 const char *resources, bool visible, bool logging,
                                                 void *environment, void *log) {
  (void)name, (void)resources, (void)visible, (void)logging, (void)environment, (void)log;
  return instance(token);
}
EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    const char *name, const char *token, const char *resources, bool visible, bool logging,
    bool events, bool early, const uint32_t needed[], size_t n, void *environment, void *log,
    void *update) {
  (void)name, (void)resources, (void)visible, (void)logging, (void)environment, (void)log;
  (void)events, (void)early, (void)needed, (void)n, (void)update;
  return instance(token);
}
EXPORT fmi3Instance fmi3InstantiateScheduledExecution(const char *name, const char *token,
                                                      const char *resources, bool visible,
                                                      bool logging, void *environment, void *log,
                                                      void *clock, void *lock, void *unlock) {
  (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment;
  (void)log, (void)clock, (void)lock, (void)unlock;
  return NULL;
}
EXPORT void fmi3FreeInstance(fmi3Instance c) { destroy(c); }
EXPORT int fmi3EnterInitializationMode(fmi3Instance c, bool defined, double tolerance,
                                       double start, bool ends, double stop) {
  (void)defined, (void)tolerance, (void)ends, (void)stop;
  ((Body *)c)->s.time = start;
  return OK;
}
EXPORT int fmi3ExitInitializationMode(fmi3Instance c) { return (void)c, OK; }
EXPORT int fmi3EnterEventMode(fmi3Instance c) { return (void)c, OK; }
EXPORT int fmi3Terminate(fmi3Instance c) { return (void)c, OK; }
EXPORT int fmi3Reset(fmi3Instance c) { return reset(c), OK; }
EXPORT int fmi3GetFloat64(fmi3Instance c, const uint32_t v[], size_t n, double value[],
                          size_t count) {
  return n == count ? get(c, v, n, value) : FAILED;
}
EXPORT int fmi3SetFloat64(fmi3Instance c, const uint32_t v[], size_t n, const double value[],
                          size_t count) {
  return n == count ? set(c, v, n, value) : FAILED;
}
#define NONE(kind, type)                                                                   \
  EXPORT int fmi3Get##kind(fmi3Instance c, const uint32_t v[], size_t n, type value[],     \
                           size_t count) {                                                 \
    return (void)c, (void)v, (void)value, (void)count, n ? FAILED : OK;                    \
  }                                                                                        \
  EXPORT int fmi3Set##kind(fmi3Instance c, const uint32_t v[], size_t n,                   \
                           const type value[], size_t count) {                             \
    return (void)c, (void)v, (void)value, (void)count, n ? FAILED : OK;                    \
  }
NONE(Float32, float)
NONE(Int8, int8_t)
NONE(UInt8, uint8_t)
NONE(Int16, int16_t)
NONE(UInt16, uint16_t)
NONE(Int32, int32_t)
NONE(UInt32, uint32_t)
NONE(Int64, int64_t)
NONE(UInt64, uint64_t)
NONE(Boolean, bool)
NONE(String, char *)
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
#define NO(name, ...)                                                                      \
  EXPORT int name(fmi3Instance c, __VA_ARGS__) { return (void)c, FAILED; }
NO(fmi3GetBinary, const uint32_t *v, size_t n, size_t *s, const uint8_t **x, size_t k)
NO(fmi3SetBinary, const uint32_t *v, size_t n, const size_t *s, const uint8_t *const *x,
   size_t k)
NO(fmi3GetClock, const uint32_t *v, size_t n, bool *x)
NO(fmi3SetClock, const uint32_t *v, size_t n, const bool *x)
NO(fmi3GetNumberOfVariableDependencies, uint32_t v, size_t *n)
NO(fmi3GetVariableDependencies, uint32_t v, size_t *a, uint32_t *b, size_t *d, int *k, size_t n)
NO(fmi3GetDirectionalDerivative, const uint32_t *a, size_t n, const uint32_t *b, size_t k,
   const double *x, size_t nx, double *y, size_t ny)
NO(fmi3GetAdjointDerivative, const uint32_t *a, size_t n, const uint32_t *b, size_t k,
   const double *x, size_t nx, double *y, size_t ny)
NO(fmi3GetIntervalDecimal, const uint32_t *v, size_t n, double *x, int *q)
NO(fmi3GetIntervalFraction, const uint32_t *v, size_t n, uint64_t *x, uint64_t *r, int *q)
NO(fmi3GetShiftDecimal, const uint32_t *v, size_t n, double *x)
NO(fmi3GetShiftFraction, const uint32_t *v, size_t n, uint64_t *x, uint64_t *r)
NO(fmi3SetIntervalDecimal, const uint32_t *v, size_t n, const double *x)
NO(fmi3SetIntervalFraction, const uint32_t *v, size_t n, const uint64_t *x, const uint64_t *r)
NO(fmi3SetShiftDecimal, const uint32_t *v, size_t n, const double *x)
NO(fmi3SetShiftFraction, const uint32_t *v, size_t n, const uint64_t *x, const uint64_t *r)
NO(fmi3ActivateModelPartition, uint32_t v, double t)
EXPORT int fmi3EnterConfigurationMode(fmi3Instance c) { return (void)c, FAILED; }
EXPORT int fmi3ExitConfigurationMode(fmi3Instance c) { return (void)c, FAILED; }
EXPORT int fmi3GetFMUState(fmi3Instance c, void **kept) { return keep(c, kept); }
EXPORT int fmi3SetFMUState(fmi3Instance c, void *kept) { return restore(c, kept); }
EXPORT int fmi3FreeFMUState(fmi3Instance c, void **kept) { return (void)c, forget(kept); }
EXPORT int fmi3SerializedFMUStateSize(fmi3Instance c, void *kept, size_t *size) {
  return (void)c, (void)kept, *size = sizeof(State), OK;
}
EXPORT int fmi3SerializeFMUState(fmi3Instance c, void *kept, uint8_t bytes[], size_t size) {
  (void)c;
  return size < sizeof(State) ? FAILED : (memcpy(bytes, kept, sizeof(State)), OK);
}
EXPORT int fmi3DeserializeFMUState(fmi3Instance c, const uint8_t bytes[], size_t size,
                                   void **kept) {
  if (size < sizeof(State) || keep(c, kept) != OK) return FAILED;
  memcpy(*kept, bytes, sizeof(State));
  return OK;
}
EXPORT int fmi3EvaluateDiscreteStates(fmi3Instance c) { return (void)c, OK; }
EXPORT int fmi3UpdateDiscreteStates(fmi3Instance c, bool *needed, bool *end, bool *nominals,
                                    bool *values, bool *defined, double *next) {
  (void)c;
  *needed = *end = *nominals = *values = *defined = false;
  *next = 0;
  return OK;
}
EXPORT int fmi3EnterContinuousTimeMode(fmi3Instance c) { return (void)c, OK; }
EXPORT int fmi3CompletedIntegratorStep(fmi3Instance c, bool kept, bool *event, bool *end) {
  return (void)c, (void)kept, *event = *end = false, OK;
}
EXPORT int fmi3SetTime(fmi3Instance c, double time) {
  ((Body *)c)->s.time = time;
  return OK;
}
EXPORT int fmi3SetContinuousStates(fmi3Instance c, const double x[], size_t n) {
  if (n != NX) return FAILED;
  memcpy(((Body *)c)->s.x, x, sizeof(double) * NX);
  return OK;
}
EXPORT int fmi3GetContinuousStateDerivatives(fmi3Instance c, double dx[], size_t n) {
  return n == NX ? (rates(c, dx), OK) : FAILED;
}
EXPORT int fmi3GetEventIndicators(fmi3Instance c, double e[], size_t n) {
  return (void)c, (void)e, n ? FAILED : OK;
}
EXPORT int fmi3GetContinuousStates(fmi3Instance c, double x[], size_t n) {
  if (n != NX) return FAILED;
  memcpy(x, ((Body *)c)->s.x, sizeof(double) * NX);
  return OK;
}
EXPORT int fmi3GetNominalsOfContinuousStates(fmi3Instance c, double x[], size_t n) {
  (void)c;
  for (size_t i = 0; i < n; ++i) x[i] = 1;
  return OK;
}
EXPORT int fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n) {
  return (void)c, *n = 0, OK;
}
EXPORT int fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n) {
  return (void)c, *n = NX, OK;
}
EXPORT int fmi3EnterStepMode(fmi3Instance c) { return (void)c, OK; }
EXPORT int fmi3GetOutputDerivatives(fmi3Instance c, const uint32_t v[], size_t n,
                                    const int32_t order[], double value[], size_t count) {
  return (void)c, (void)v, (void)order, (void)value, (void)count, n ? FAILED : OK;
}
EXPORT int fmi3DoStep(fmi3Instance c, double time, double h, bool no_set, bool *event, bool *end,
                      bool *early, double *last) {
  (void)no_set;
  ((Body *)c)->s.time = time;
  *event = *end = *early = false;
  const int status = step(c, h);
  *last = ((Body *)c)->s.time;
  return status;
}

#endif
