/* See controller.h. Written by robustid. */
#include "controller.h"

/* Zero initial conditions. */
void controller_reset(controller_state *s)
{
  int k;
  for (k = 0; k < 2; k++) s->x[k] = s->rest[k] = 0;
}

/* Output u of this sample for the input e, then the state of the next one. */
void controller_step(controller_state *s, const controller_real *e, const controller_real *ahead, const controller_real *lower,
  const controller_real *upper, controller_real *u)
{
  static const controller_real f[2][2] = {{0, 0}, {0, -0.59999999999999987}};
  static const short from[2] = {0, 1}, to[2] = {0, 2};  /* columns of f that are not zero */
  static const controller_real t[2][1] = {{0}, {1.5275252316519468}};
  static const controller_real h[2][1] = {{1}, {0}};
  static const controller_real c[1][2] = {{0.083333333333333287, -0.81104315871043808}};
  static const controller_real d[1][1] = {{1.3611111111111127}};
  static const controller_real l[2][1] = {{0.38334993234611764}, {0.34980573273342019}};
  controller_real v[2], w[1];
  int i, j, k;
  for (k = 0; k < 2; k++) {
    controller_real still = 0;
    for (j = 0; j < 1; j++) still += t[k][j] * e[j];
    v[k] = (s->x[k] - still) + s->rest[k];
  }
  for (i = 0; i < 1; i++) {
    controller_real wanted = ahead ? ahead[i] : 0, put;
    for (k = 0; k < 2; k++) wanted += c[i][k] * v[k];
    for (j = 0; j < 1; j++) wanted += d[i][j] * e[j];
    put = wanted;
    if (lower && put < lower[i]) put = lower[i];
    if (upper && put > upper[i]) put = upper[i];
    u[i] = put;
    w[i] = put - wanted;
  }
  for (k = 0; k < 2; k++) {
    controller_real change = s->rest[k], before = s->x[k], after, added;
    for (j = from[k]; j < to[k]; j++) change += f[k][j] * v[j];
    for (j = 0; j < 1; j++) change += h[k][j] * e[j];
    for (i = 0; i < 1; i++) change += l[k][i] * w[i];
    after = before + change;
    added = after - before;
    s->rest[k] = (before - (after - added)) + (change - added);
    s->x[k] = after;
  }
}
