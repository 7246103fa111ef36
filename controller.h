/* controller: a controller of 1 input(s), 1 output(s), 2 states, sampled at 0.001 s. Written by robustid.

   Once: controller_reset(&state). Every 0.001 s: controller_step(&state, e, ahead, lower, upper, u), with
     e      the input: reference minus measurement. (Of u = r - C y: minus the measurement, and `ahead` is r.)
     ahead  is added to the output before it is limited; 0: nothing
     lower, upper  limits of the output, which may change at any time; 0: none. Both equal to what is put out by hand: it follows.
     u      the output, limited. If the actuator does less, give what it does as limits.

   Anti-windup: u = sat(C x + D e) and x+ = A x + B e + L (u - C x - D e), an observer of the output that was realised.
   While nothing is limited the last term is zero, and the loop is the linear one. A - L C has its poles within
   |z| <= 1 - 6.9e-02: a limited controller is stable, integrators too. L is the stationary Kalman gain for e as white
   noise and an error of the output of 0.1 of the median gain. Where all zeros of the controller are well inside the
   unit circle it is close to B D^-1, the conditioned controller (Hanus, Kinnaert, Henrotte, Automatica 23(6), 1987).

   Numbers: v = x - T e, x+ = x + F v + H e + L w, u = C v + D e. F is A - I, v what the states lag behind their values at
   standstill; integrators and what works as such have rows in H. `rest` holds what a sum rounded off: a slow state loses
   nothing in single precision. The response differs from that of the controller by at most 4.9e-15 of it in double
   and 4.4e-08 in single precision (at 401 frequencies; where it is below 0.01 of its median, in part of that).
   C99, no library. Compile with -DCONTROLLER_SINGLE for single precision, and never with -ffast-math, which drops `rest`. */
#ifndef CONTROLLER_H
#define CONTROLLER_H
#ifdef __FAST_MATH__
#error "controller needs sums as they are written: compile without -ffast-math"
#endif
#ifdef CONTROLLER_SINGLE
typedef float controller_real;
#else
typedef double controller_real;
#endif
#define CONTROLLER_STATES 2
#define CONTROLLER_INPUTS 1
#define CONTROLLER_OUTPUTS 1
typedef struct { controller_real x[2], rest[2]; } controller_state;

void controller_reset(controller_state *s);
void controller_step(controller_state *s, const controller_real *e, const controller_real *ahead, const controller_real *lower,
  const controller_real *upper, controller_real *u);
#endif
