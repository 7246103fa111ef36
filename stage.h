/* stage: 1 output(s), 1 input(s), 4 states, sampled at 0.01 s. Written by robustid.
   Every state belongs to a mode of its own, or to one damped rotation of two: short loops, little lost to rounding of coefficients.
   Coefficients in double precision move the response by at most 5.6e-14 of it, in single precision by 2.9e-06
   (at 402 frequencies; of what is below a millionth of its largest value, in part of that).
   Compile with -DSTAGE_SINGLE for single precision. A state starts as {0}. */
#ifndef STAGE_H
#define STAGE_H
#ifdef STAGE_SINGLE
typedef float stage_real;
#else
typedef double stage_real;
#endif
#define STAGE_STATES 4
#define STAGE_INPUTS 1
#define STAGE_OUTPUTS 1
typedef struct { stage_real x[4]; } stage_state;

/* Output y of this sample for input u, then the state of the next one. */
static inline void stage_step(stage_state *s, const stage_real *u, stage_real *y)
{
  static const stage_real a[4] = {0.79933930077970561, 0.79933930077970561, 0.442486097620992, 0.442486097620992};       /* of a state on itself */
  static const stage_real w[4] = {0.5041035719806487, 0, 0.89183152574361724, 0};       /* on its partner: + from the first to the second, - back */
  static const unsigned char pair[4] = {1, 0, 1, 0};  /* 1: first of two */
  static const stage_real b[4][1] = {{0.19652791099231554}, {-0.68690876974335646}, {0.14278328242466859}, {-0.23045012256909572}};
  static const stage_real c[1][4] = {{0.68690876974335646, 0, 0.23045012256909578, 0}};
  static const stage_real d[1][1] = {{0}};
  int i, j, k;
  for (i = 0; i < 1; i++) {
    stage_real sum = 0;
    for (k = 0; k < 4; k++) sum += c[i][k] * s->x[k];
    for (j = 0; j < 1; j++) sum += d[i][j] * u[j];
    y[i] = sum;
  }
  for (k = 0; k < 4; k += pair[k] ? 2 : 1) {
    stage_real p = a[k] * s->x[k], q = 0;
    if (pair[k]) {
      p -= w[k] * s->x[k + 1];
      q = w[k] * s->x[k] + a[k] * s->x[k + 1];
    }
    for (j = 0; j < 1; j++) p += b[k][j] * u[j];
    s->x[k] = p;
    if (pair[k]) {
      for (j = 0; j < 1; j++) q += b[k + 1][j] * u[j];
      s->x[k + 1] = q;
    }
  }
}
#endif
