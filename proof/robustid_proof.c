/* robustid-proof FILE: check a proof of what finitely many samples say about all systems of a class.
 *
 * The format, and the mathematics of every step, are in docs/proof_format.rst; the names here are those of that page.
 * Nothing here is a floating-point number. Every number is a ball m 2^e +- r 2^e of integers; rounding only widens it.
 * Exit status: 0 every statement is proved, 1 one is not, 2 the file cannot be read. Build: cc -O2 -o robustid-proof robustid_proof.c -lgmp
 */
#include <gmp.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* What a file may ask for. */
enum { DEPTH = 16, TEXT = 400, DIGITS = 400, DYADIC = 4000, DECIMAL = 400, RANGE = 40000, CACHED = 200 };
enum { SAMPLES = 20000, FUNCTIONS = 64, TERMS = 4096, LARGEST = 64 << 20 };
static void unreadable(const char *why, const char *what) {
    printf("not readable: %s%s%s\n", why, *what ? ": " : "", what);
    exit(2);
}
static void *room(size_t count, size_t size) {
    void *found = calloc(count ? count : 1, size);
    if (!found) unreadable("not enough memory", "");
    return found;
}

/* ---- Balls. `lost` is set where a result has no bound: a division by what may be 0, or numbers out of range. ---- */
typedef struct { mpz_t m, r; long e; } ball;
typedef struct { ball re, im; } cball;
static unsigned long precision = 256;
static int lost;
static mpz_t T1, T2, T3;
static ball B1, B2, B3, B4;
static cball C1, C2;
static void ball_init(ball *x) { mpz_init(x->m); mpz_init(x->r); x->e = 0; }
static void cball_init(cball *x) { ball_init(&x->re); ball_init(&x->im); }
/* Variables that functions keep, made once. */
#define HELD(type, x) static type x; do { static int made_; if (!made_) { type##_init(&x); made_ = 1; } } while (0)
static cball *c_array(size_t count) {
    cball *found = room(count, sizeof *found);
    for (size_t k = 0; k < count; k++) cball_init(found + k);
    return found;
}
static ball *b_array(size_t count) {
    ball *found = room(count, sizeof *found);
    for (size_t k = 0; k < count; k++) ball_init(found + k);
    return found;
}
static void c_free(cball *x, size_t count) {
    for (size_t k = 0; k < count; k++) mpz_clears(x[k].re.m, x[k].re.r, x[k].im.m, x[k].im.r, NULL);
    free(x);
}
static void b_set(ball *z, const ball *x) { mpz_set(z->m, x->m); mpz_set(z->r, x->r); z->e = x->e; }
static void b_integer(ball *z, long value) { mpz_set_si(z->m, value); mpz_set_ui(z->r, 0); z->e = 0; }
static int b_zero(const ball *x) { return !mpz_sgn(x->m) && !mpz_sgn(x->r); }
static void b_round(ball *x) {
    size_t bits = mpz_sizeinbase(x->m, 2), wide = mpz_sizeinbase(x->r, 2);
    if (wide > bits) bits = wide;
    if (bits > precision) {
        unsigned long s = bits - precision;
        int exact = mpz_divisible_2exp_p(x->m, s);
        mpz_fdiv_q_2exp(x->m, x->m, s); mpz_cdiv_q_2exp(x->r, x->r, s);
        if (!exact) mpz_add_ui(x->r, x->r, 1);
        x->e += (long)s;
    }
    if (b_zero(x)) x->e = 0;
    if (x->e > RANGE || x->e < -RANGE) { lost = 1; b_integer(x, 0); }
}
static void b_add(ball *z, const ball *x, const ball *y) {
    if (b_zero(x)) { if (z != y) b_set(z, y); return; }
    if (b_zero(y)) { if (z != x) b_set(z, x); return; }
    const ball *high = x->e >= y->e ? x : y, *low = high == x ? y : x;
    unsigned long s = (unsigned long)(high->e - low->e);
    long e = low->e;
    mpz_mul_2exp(T1, high->m, s); mpz_add(T1, T1, low->m);
    mpz_mul_2exp(T2, high->r, s); mpz_add(T2, T2, low->r);
    mpz_swap(z->m, T1); mpz_swap(z->r, T2); z->e = e;
    b_round(z);
}
static void b_neg(ball *z, const ball *x) { if (z != x) b_set(z, x); mpz_neg(z->m, z->m); }
static void b_sub(ball *z, const ball *x, const ball *y) { b_neg(&B4, y); b_add(z, x, &B4); }
static void b_mul(ball *z, const ball *x, const ball *y) {
    mpz_mul(T2, x->r, y->r);
    mpz_abs(T3, x->m); mpz_addmul(T2, T3, y->r);
    mpz_abs(T3, y->m); mpz_addmul(T2, T3, x->r);
    mpz_mul(T1, x->m, y->m);
    mpz_swap(z->m, T1); mpz_swap(z->r, T2); z->e = x->e + y->e;
    b_round(z);
}

/* |x/y - m_x/m_y| <= (r_x |m_y| + |m_x| r_y)/(|m_y| (|m_y| - r_y)). */
static void b_div(ball *z, const ball *x, const ball *y) {
    if (mpz_cmpabs(y->m, y->r) <= 0) { lost = 1; b_integer(z, 0); return; }
    unsigned long s = precision + 2 + mpz_sizeinbase(y->m, 2);
    long e = x->e - y->e - (long)s;
    mpz_abs(T1, y->m); mpz_abs(T2, x->m);
    mpz_mul(T3, x->r, T1); mpz_addmul(T3, T2, y->r); mpz_mul_2exp(T3, T3, s);
    mpz_sub(T2, T1, y->r); mpz_mul(T2, T2, T1); mpz_cdiv_q(T3, T3, T2);
    mpz_mul_2exp(T1, x->m, s);
    if (!mpz_divisible_p(T1, y->m)) mpz_add_ui(T3, T3, 1);
    mpz_fdiv_q(T1, T1, y->m);
    mpz_swap(z->m, T1); mpz_swap(z->r, T3); z->e = e;
    b_round(z);
}
static void b_above(ball *z, const ball *x) { /* an exact number that is not below x */
    if (z != x) b_set(z, x);
    mpz_add(z->m, z->m, z->r); mpz_set_ui(z->r, 0);
}
static void b_root_above(ball *z, const ball *x) { /* an exact number that is not below the root of x; 0 of negative ones */
    b_above(z, x);
    if (mpz_sgn(z->m) <= 0) { b_integer(z, 0); return; }
    unsigned long s = 2 * precision + ((z->e % 2) != 0);
    mpz_mul_2exp(z->m, z->m, s);
    mpz_sqrt(z->m, z->m); mpz_add_ui(z->m, z->m, 1);
    z->e = (z->e - (long)s) / 2;
    b_round(z); b_above(z, z);
}
static int b_not_negative(const ball *x) { return !lost && mpz_cmp(x->m, x->r) >= 0; }
static int b_positive(const ball *x) { return !lost && mpz_cmp(x->m, x->r) > 0; }
static int b_at_most(const ball *x, const ball *y) { b_sub(&B3, y, x); return b_not_negative(&B3); }
static int b_less(const ball *x, const ball *y) { b_sub(&B3, y, x); return b_positive(&B3); }
static void c_set(cball *z, const cball *x) { b_set(&z->re, &x->re); b_set(&z->im, &x->im); }
static void c_conj(cball *z, const cball *x) { if (z != x) c_set(z, x); mpz_neg(z->im.m, z->im.m); }
static void c_integer(cball *z, long value) { b_integer(&z->re, value); b_integer(&z->im, 0); }
static void c_add(cball *z, const cball *x, const cball *y) { b_add(&z->re, &x->re, &y->re); b_add(&z->im, &x->im, &y->im); }
static void c_sub(cball *z, const cball *x, const cball *y) { b_sub(&z->re, &x->re, &y->re); b_sub(&z->im, &x->im, &y->im); }
static void c_mul(cball *z, const cball *x, const cball *y) {
    b_mul(&B1, &x->re, &y->re); b_mul(&B2, &x->im, &y->im); b_sub(&C1.re, &B1, &B2);
    b_mul(&B1, &x->re, &y->im); b_mul(&B2, &x->im, &y->re); b_add(&C1.im, &B1, &B2);
    c_set(z, &C1);
}
static void c_scale(cball *z, const cball *x, const ball *y) { b_mul(&z->re, &x->re, y); b_mul(&z->im, &x->im, y); }
static void c_mul_conj(cball *z, const cball *x, const cball *y) { c_conj(&C2, y); c_mul(z, x, &C2); }
static void c_square(ball *z, const cball *x) { b_mul(&B1, &x->re, &x->re); b_mul(&B2, &x->im, &x->im); b_add(z, &B1, &B2); }
static void c_div(cball *z, const cball *x, const cball *y) {
    HELD(ball, size);
    c_square(&size, y); c_mul_conj(z, x, y);
    b_div(&z->re, &z->re, &size); b_div(&z->im, &z->im, &size);
}
static void c_abs_above(ball *z, const cball *x) {
    int real = b_zero(&x->im);
    if (!real && !b_zero(&x->re)) { c_square(z, x); b_root_above(z, z); return; }
    b_set(z, real ? &x->re : &x->im); /* exactly */
    mpz_abs(z->m, z->m);
    b_above(z, z);
}
static void accumulate(cball *z, const cball *x, const cball *y) { HELD(cball, one); c_mul(&one, x, y); c_add(z, z, &one); }
static void accumulate_conj(cball *z, const cball *x, const cball *y) { HELD(cball, one); c_mul_conj(&one, x, y); c_add(z, z, &one); }

/* exp(-j x), |x| <= 4. From the term n >= 8 on every term is at most half the one before, so that those left out are together at
 * most the last one that was added. */
static void c_turn(cball *z, const ball *x) {
    HELD(ball, size); HELD(ball, n); HELD(cball, term); HELD(cball, by);
    b_integer(&n, 4);
    b_set(&size, x); mpz_abs(size.m, size.m);
    if (!b_at_most(&size, &n)) { lost = 1; c_integer(z, 0); return; }
    c_integer(&by, 0); b_neg(&by.im, x);
    c_integer(&term, 1); c_integer(z, 1);
    for (long k = 1; ; k++) {
        c_mul(&term, &term, &by); b_integer(&n, k);
        b_div(&term.re, &term.re, &n); b_div(&term.im, &term.im, &n);
        c_add(z, z, &term); c_abs_above(&size, &term);
        if (lost || (k >= 8 && (b_zero(&size) || (long)mpz_sizeinbase(size.m, 2) + size.e < -(long)precision))) break;
    }
    mpz_swap(size.r, size.m); mpz_set_ui(size.m, 0);
    b_add(&z->re, &z->re, &size); b_add(&z->im, &z->im, &size);
}

/* ---- Text: JSON in printable ASCII, without escapes; objects with exactly the keys that are expected. ---- */
typedef struct node { char kind; const char *start, *end; const char *key; size_t key_size; size_t count; struct node *child, *next; } node;
static const char *at, *stop;
static void blank(void) { while (at < stop && (*at == ' ' || *at == '\n' || *at == '\r' || *at == '\t')) at++; }
static void expect(char c) { if (at >= stop || *at != c) { char s[2] = {c, 0}; unreadable("something else where there must be", s); } at++; }
static void string(const char **start, size_t *size) {
    expect('"');
    *start = at;
    while (at < stop && *at != '"') {
        if (*at < 0x20 || *at > 0x7e || *at == '\\') unreadable("a character that strings must not hold", "");
        at++;
    }
    *size = (size_t)(at - *start); expect('"');
    if (*size > TEXT) unreadable("a string that is too long", "");
}
static node *value(int depth) {
    node *found = room(1, sizeof *found), **last = &found->child;
    size_t size;
    if (depth > DEPTH) unreadable("too deeply nested", "");
    blank();
    if (at >= stop) unreadable("the file ends too early", "");
    found->start = at;
    if (*at == '"') {
        string(&found->start, &size);
        found->kind = 's'; found->end = found->start + size;
        return found;
    }
    if (*at >= '0' && *at <= '9') {
        for (size = 0; at < stop && *at >= '0' && *at <= '9'; at++) if (++size > 9) unreadable("an index that is too large", "");
        if (size > 1 && *found->start == '0') unreadable("an index that begins with 0", "");
        found->kind = 'i'; found->end = at;
        return found;
    }
    if (*at != '{' && *at != '[') unreadable("a value that is no string, index, list or object", "");
    int object = *at == '{';
    found->kind = object ? 'o' : 'a';
    at++; blank();
    while (!(at < stop && !found->count && *at == (object ? '}' : ']'))) {
        const char *key = NULL; size_t key_size = 0;
        if (object) {
            blank(); string(&key, &key_size); blank(); expect(':');
            if (found->count >= 16) unreadable("too many keys", "");
            for (node *one = found->child; one; one = one->next)
                if (one->key_size == key_size && !memcmp(one->key, key, key_size)) unreadable("a key that stands twice", "");
        }
        *last = value(depth + 1);
        (*last)->key = key; (*last)->key_size = key_size;
        last = &(*last)->next; found->count++;
        blank();
        if (at >= stop || *at != ',') break;
        at++;
    }
    expect(object ? '}' : ']');
    found->end = at;
    return found;
}
static node *find(const node *object, const char *key) {
    node *one = object->child;
    while (one && !(one->key_size == strlen(key) && !memcmp(one->key, key, one->key_size))) one = one->next;
    return one;
}
static void fields(const node *object, const char *keys[], size_t count, node *found[]) {
    if (object->kind != 'o' || object->count != count) unreadable("an object has other keys than it must; one must be", keys[0]);
    for (size_t k = 0; k < count; k++) {
        found[k] = find(object, keys[k]);
        if (!found[k]) unreadable("a key is missing", keys[k]);
    }
}
#define FIELDS(object, found, ...) do { const char *keys_[] = {__VA_ARGS__}; fields(object, keys_, sizeof keys_ / sizeof *keys_, found); } while (0)
static node *list(node *one, const char *what) { if (one->kind != 'a') unreadable("there must be a list", what); return one->child; }
static node *list_of(node *one, size_t count, const char *what) {
    if (one->kind != 'a' || one->count != count) unreadable("a list of another length than it must have", what);
    return one->child;
}
static int is(const node *one, const char *text) {
    return one->kind == 's' && (size_t)(one->end - one->start) == strlen(text) && !memcmp(one->start, text, strlen(text));
}
static size_t index_below(const node *one, size_t limit) {
    if (one->kind != 'i') unreadable("there must be an index", "");
    size_t found = 0;
    for (const char *s = one->start; s < one->end; s++) found = 10 * found + (size_t)(*s - '0');
    if (found >= limit) unreadable("an index out of range", "");
    return found;
}

/* "-12.5e-3" or "-123p-60" (an integer times a power of two). */
static void number(ball *z, const node *one) {
    static const char *bad = "there must be a number in a string, as \"-1.5e-3\" or \"-123p-60\"";
    if (one->kind != 's') unreadable(bad, "");
    char digits[DIGITS + 2]; size_t count = 0; long exponent = 0, shift = 0;
    const char *s = one->start, *end = one->end;
    int negative = s < end && *s == '-', point = 0, seen = 0;
    if (negative) s++;
    for (; s < end && ((*s >= '0' && *s <= '9') || (*s == '.' && !point && seen)); s++) {
        if (*s == '.') { point = 1; seen = 0; continue; }
        if (count >= DIGITS) unreadable("a number with too many digits", "");
        digits[count++] = *s; seen = 1; shift += point;
    }
    if (!seen) unreadable(bad, "");
    int dyadic = s < end && *s == 'p';
    if (dyadic && point) unreadable(bad, "");
    if (s < end && (dyadic || *s == 'e')) {
        int minus = ++s < end && *s == '-';
        if (s < end && (*s == '-' || *s == '+')) s++;
        if (s >= end || end - s > 4) unreadable(bad, "");
        for (; s < end; s++) { if (*s < '0' || *s > '9') unreadable(bad, ""); exponent = 10 * exponent + (*s - '0'); }
        if (exponent > (dyadic ? DYADIC : DECIMAL)) unreadable("an exponent that is too large", "");
        if (minus) exponent = -exponent;
    }
    if (s != end) unreadable(bad, "");
    digits[count] = 0;
    b_integer(z, 0); mpz_set_str(z->m, digits, 10);
    if (negative) mpz_neg(z->m, z->m);
    if (dyadic) { z->e = exponent; b_round(z); return; }
    HELD(ball, ten); exponent -= shift;
    b_integer(&ten, 0);
    mpz_ui_pow_ui(ten.m, 10, (unsigned long)labs(exponent));
    if (exponent >= 0) { mpz_mul(z->m, z->m, ten.m); b_round(z); return; }
    b_div(z, z, &ten);
}
static void positive(ball *z, const node *one, const char *what) {
    number(z, one);
    if (mpz_cmp(z->m, z->r) <= 0) unreadable("a number that must be positive", what);
}
static void pair(cball *z, node *one) {
    node *child = list_of(one, 2, "a complex number [re, im]");
    number(&z->re, child); number(&z->im, child->next);
}
static void numbers(ball *z, node *one, size_t count, const char *what) {
    for (one = list_of(one, count, what); one; one = one->next) number(z++, one);
}
/* One (re, im) a row with an index first: [[k, re, im], ...]. */
static size_t terms(node *one, size_t limit, size_t **index, cball **values) {
    size_t count = 0, total = one->count;
    node *row = list(one, "rows [k, re, im]");
    if (total > TERMS) unreadable("more rows [k, re, im] than version 1 allows", "");
    *index = room(total, sizeof **index); *values = c_array(total);
    for (; row; row = row->next, count++) {
        node *child = list_of(row, 3, "a row [k, re, im]");
        (*index)[count] = index_below(child, limit);
        number(&(*values)[count].re, child->next); number(&(*values)[count].im, child->next->next);
    }
    return total;
}

/* ---- The question. Nodes 0..N-1 are those of the samples, N..2N-1 their conjugates, 2N and 2N+1 those of a statement. ---- */
static size_t N, M, S; /* samples, parametric functions, states of these */
static ball K, rho, sample_time, *bounds, *about, *within;
static cball *samples, *zeta, *functions, *cauchy; /* functions: M a node */
static char *known;
static int unknown; /* nothing is proved of the parameters */
static ball *A, *B, *C, *D;

/* zeta and the values C (z - A)^-1 B + D of the functions at exp(j omega T), for node k and its conjugate. */
static void place(size_t k, size_t conjugate, const node *omega) {
    HELD(ball, x); HELD(ball, size); HELD(ball, other); HELD(cball, z); HELD(cball, unit);
    number(&x, omega); b_mul(&x, &x, &sample_time);
    if (mpz_cmp(x.m, x.r) < 0 && !(b_zero(&x))) unreadable("a frequency that is negative", "");
    int before = lost;
    lost = 0;
    c_turn(&z, &x);
    if (lost) unreadable("a frequency that is far above half the sample rate", "");
    lost = before;
    b_div(&zeta[k].re, &z.re, &rho); b_div(&zeta[k].im, &z.im, &rho);
    c_conj(&zeta[conjugate], &zeta[k]);
    c_conj(&z, &z); /* exp(+j omega T) */
    cball *left = c_array(S * (S + 1)), *row = functions + k * M;
    size_t wide = S + 1;
    for (size_t a = 0; a < S; a++) {
        for (size_t b = 0; b < S; b++) {
            c_integer(&left[a * wide + b], 0); b_neg(&left[a * wide + b].re, &A[a * S + b]);
            if (a == b) c_add(&left[a * wide + b], &left[a * wide + b], &z);
        }
        c_integer(&left[a * wide + S], 0); b_set(&left[a * wide + S].re, &B[a]);
    }
    for (size_t p = 0; p < S; p++) { /* Gauss-Jordan; the pivot with the largest middle */
        size_t best = p;
        c_square(&size, &left[p * wide + p]);
        for (size_t a = p + 1; a < S; a++) {
            c_square(&other, &left[a * wide + p]);
            if (b_less(&size, &other)) { best = a; b_set(&size, &other); }
        }
        for (size_t b = 0; best != p && b < wide; b++) {
            cball swap = left[p * wide + b]; left[p * wide + b] = left[best * wide + b]; left[best * wide + b] = swap;
        }
        for (size_t b = wide; b-- > p;) c_div(&left[p * wide + b], &left[p * wide + b], &left[p * wide + p]);
        for (size_t a = 0; a < S; a++) if (a != p)
            for (size_t b = wide; b-- > p;) {
                c_mul(&unit, &left[a * wide + p], &left[p * wide + b]);
                c_sub(&left[a * wide + b], &left[a * wide + b], &unit);
            }
    }
    for (size_t i = 0; i < M; i++) {
        c_integer(&row[i], 0); b_set(&row[i].re, &D[i]);
        for (size_t a = 0; a < S; a++) { c_scale(&unit, &left[a * wide + S], &C[i * S + a]); c_add(&row[i], &row[i], &unit); }
        c_conj(&functions[conjugate * M + i], &row[i]);
    }
    c_free(left, S * wide);
}

/* 1/(1 - zeta_k conj(zeta_l)). */
static void szego(cball *z, size_t k, size_t l) {
    HELD(cball, one);
    cball *kept = cauchy && k < 2 * N && l < 2 * N ? cauchy + k * 2 * N + l : NULL;
    if (kept && known[k * 2 * N + l]) { c_set(z, kept); return; }
    c_mul_conj(&one, &zeta[k], &zeta[l]);
    c_integer(z, 1); c_sub(&one, z, &one); c_div(z, z, &one);
    if (kept) {
        c_set(kept, z); c_conj(cauchy + l * 2 * N + k, z);
        known[k * 2 * N + l] = known[l * 2 * N + k] = 1;
    }
}

/* ---- The sums. ---- */

/* Above the norm of the functional sum c_k phi(zeta at node_k) in H2 of the harmonic measure seen from `base`, |base| < 1: the root of
 * sum t_k t_l* / (1 - zeta_k zeta_l*) / (1 - |base|^2), t = c (1 - base* zeta). */
static void norm_above(ball *z, size_t count, const size_t *node_of, const cball *c, const cball *base) {
    HELD(cball, one); HELD(cball, unit); HELD(cball, row); HELD(cball, total); HELD(ball, scale);
    cball *t = c_array(count);
    c_integer(&unit, 1); c_integer(&total, 0);
    for (size_t k = 0; k < count; k++) {
        c_mul_conj(&one, &zeta[node_of[k]], base); c_sub(&one, &unit, &one);
        c_mul(&t[k], &c[k], &one); c_integer(&row, 0);
        for (size_t l = 0; l < k; l++) {
            szego(&one, node_of[k], node_of[l]);
            accumulate_conj(&row, &one, &t[l]);
        }
        c_add(&row, &row, &row);
        szego(&one, node_of[k], node_of[k]);
        accumulate_conj(&row, &one, &t[k]);
        accumulate(&total, &row, &t[k]);
    }
    c_square(&scale, base); b_sub(&scale, &unit.re, &scale);
    if (!b_positive(&scale)) lost = 1;
    b_div(&scale, &total.re, &scale);
    b_root_above(z, &scale);
    c_free(t, count);
}

/* Takes from the functional, which stands for all 2N + 2 nodes, what (f, g) is: conj(f_k) g(zeta_k), g = sum g_l /(1 - zeta zeta_l*),
 * and adds to `total` what that costs: |f| |g|. */
static void factor(ball *total, cball *c, node *evidence) {
    node *side[2];
    size_t count[2], *node_of[2];
    cball *v[2];
    HELD(ball, size); HELD(ball, product); HELD(cball, zero); HELD(cball, one); HELD(cball, sum);
    FIELDS(evidence, side, "f", "g");
    b_integer(&product, 1);
    for (int k = 0; k < 2; k++) {
        count[k] = terms(side[k], 2 * N + 2, &node_of[k], &v[k]);
        for (size_t l = 0; l < count[k]; l++) c_conj(&v[k][l], &v[k][l]);
        norm_above(&size, count[k], node_of[k], v[k], &zero);
        b_mul(&product, &product, &size);
    }
    b_add(total, total, &product);
    for (size_t k = 0; k < count[0]; k++) {
        c_integer(&sum, 0);
        for (size_t l = 0; l < count[1]; l++) {
            szego(&one, node_of[0][k], node_of[1][l]);
            accumulate_conj(&sum, &one, &v[1][l]);
        }
        c_mul(&sum, &sum, &v[0][k]); c_sub(&c[node_of[0][k]], &c[node_of[0][k]], &sum);
    }
    for (int k = 0; k < 2; k++) { c_free(v[k], count[k]); free(node_of[k]); }
}

/* The disc that holds a functional of every consistent system: target_0 F(2N) + target_1 F(2N + 1) + sum wanted_i p_i. The part of
 * the radius that the distances of the parameters from `about` make is in `parametric`, too. */
static void sums(cball *centre, ball *radius, ball *parametric, node *evidence, const cball target[2], const ball *wanted) {
    node *part[3];
    size_t *index, all = 2 * N + 2, used = 0, *node_of = room(all, sizeof *node_of);
    cball *d, *c = c_array(all), *missed = c_array(M);
    HELD(cball, base); HELD(cball, one); HELD(ball, size); HELD(ball, cost);
    FIELDS(evidence, part, "base", "factors", "multipliers");
    pair(&base, part[0]);
    size_t count = terms(part[2], 2 * N, &index, &d);
    c_integer(centre, 0); b_integer(radius, 0); b_integer(parametric, 0); b_integer(&cost, 0);
    for (int k = 0; k < 2; k++) c_set(&c[2 * N + (size_t)k], &target[k]);
    for (size_t i = 0; i < M; i++) { /* missed = sum d_k P_i(z_k) - its target */
        b_neg(&missed[i].re, &wanted[i]);
        for (size_t k = 0; k < 2; k++) {
            if (b_zero(&target[k].re) && b_zero(&target[k].im)) continue;
            c_mul(&one, &target[k], &functions[(2 * N + k) * M + i]);
            c_sub(&missed[i], &missed[i], &one);
        }
    }
    for (size_t k = 0; k < count; k++) {
        size_t own = index[k] % N;
        c_set(&one, &samples[own]);
        if (index[k] >= N) c_conj(&one, &one);
        accumulate(centre, &one, &d[k]);
        c_abs_above(&size, &d[k]); b_mul(&size, &size, &bounds[own]);
        b_add(radius, radius, &size); c_sub(&c[index[k]], &c[index[k]], &d[k]);
        for (size_t i = 0; i < M; i++) accumulate(&missed[i], &d[k], &functions[index[k] * M + i]);
    }
    if (M && unknown) lost = 1;
    for (size_t i = 0; i < M; i++) {
        c_scale(&one, &missed[i], &about[i]); c_sub(centre, centre, &one);
        c_abs_above(&size, &missed[i]); b_mul(&size, &size, &within[i]);
        b_add(parametric, parametric, &size);
    }
    for (node *row = list(part[1], "factors"); row; row = row->next) factor(&cost, c, row);
    for (size_t k = 0; k < all; k++)
        if (!(b_zero(&c[k].re) && b_zero(&c[k].im))) { c_set(&c[used], &c[k]); node_of[used++] = k; }
    norm_above(&size, used, node_of, c, &base);
    b_add(&cost, &cost, &size); b_mul(&cost, &cost, &K);
    b_add(radius, radius, &cost); b_add(radius, radius, parametric);
    free(node_of); free(index); c_free(d, count); c_free(c, all); c_free(missed, M);
}

/* Discs of the parameters: u <= b + E u with u the distances of the parameters of a system from `about`. Where E u < u and
 * b + E u <= u for the stated u, the spectral radius of E is below 1, and no system is farther. */
static int parameters_proved(node *evidence) {
    node *part[3], *row;
    cball *target = c_array(2);
    ball *wanted = b_array(M);
    HELD(cball, centre); HELD(ball, radius); HELD(ball, parametric);
    int proved = 1;
    FIELDS(evidence, part, "centre", "radius", "combinations");
    unknown = M && !list(part[0], "centres") && !list(part[1], "radii") && !list(part[2], "combinations");
    if (unknown) return 1;
    numbers(about, part[0], M, "centres of the parameters");
    numbers(within, part[1], M, "radii of the parameters");
    row = list_of(part[2], M, "combinations of the parameters");
    for (size_t i = 0; i < M; i++, row = row->next) {
        b_integer(&wanted[i], 1);
        sums(&centre, &radius, &parametric, row, target, wanted);
        b_integer(&wanted[i], 0);
        b_sub(&centre.re, &centre.re, &about[i]); /* parameters are real */
        mpz_abs(centre.re.m, centre.re.m);
        b_add(&radius, &radius, &centre.re);
        if (!b_positive(&within[i]) || !b_at_most(&radius, &within[i]) || !b_less(&parametric, &within[i])) proved = 0;
    }
    return proved;
}

/* ---- The statements. ---- */
static void words(const node *one) { fwrite(one->start, 1, (size_t)(one->end - one->start), stdout); }
/* kind d: |F - centre| <= radius; s: Re(direction F) <= value; i: no system, since the disc of the functional 0 does not hold 0. */
static int by_sums(char kind, node *claim, node *evidence) {
    node *part[4];
    cball *target = c_array(2);
    ball *wanted = b_array(M);
    HELD(cball, centre); HELD(cball, stated); HELD(ball, radius); HELD(ball, parametric); HELD(ball, limit); HELD(ball, half);
    if (kind == 'i') {
        FIELDS(claim, part, "kind");
        sums(&centre, &radius, &parametric, evidence, target, wanted);
        b_mul(&radius, &radius, &radius); c_square(&limit, &centre);
        int none = b_less(&radius, &limit);
        puts(none ? "proved: no system of the class keeps every sample within its bound" : "not proved: no system is consistent");
        return none;
    }
    if (kind == 's') FIELDS(claim, part, "kind", "omega", "direction", "value");
    else FIELDS(claim, part, "kind", "omega", "centre", "radius");
    place(2 * N, 2 * N + 1, part[1]);
    pair(&stated, part[2]);
    number(&limit, part[3]);
    b_integer(&half, 1); half.e = -1;
    if (kind == 's') c_scale(target, &stated, &half); /* Re(u F) = (u F + u* F*)/2 */
    else c_integer(target, 1);
    if (kind == 's') c_conj(target + 1, target);
    sums(&centre, &radius, &parametric, evidence, target, wanted);
    if (kind == 's') b_set(&half, &centre.re); /* the functional is real */
    else { c_sub(&centre, &centre, &stated); c_abs_above(&half, &centre); }
    b_add(&radius, &radius, &half);
    int proved = b_at_most(&radius, &limit);
    printf("%s%s", proved ? "proved: " : "not proved: ", kind == 's' ? "Re((" : "|F - (");
    words(part[2]->child); printf(" + "); words(part[2]->child->next);
    printf(kind == 's' ? " j) F) <= " : " j)| <= "); words(part[3]);
    printf(" at "); words(part[1]); printf(" rad/s, for every consistent system\n");
    return proved;
}

/* A system: phi from its reflection coefficients g_k, |g_k| < 1, and parameters. w_L = 0, w_k = (g_k + zeta w_k+1)/(1 + g_k zeta w_k+1)
 * maps functions of norm at most 1 to such functions, whatever the g_k: phi = w_0. */
static int consistent(node *claim, node *evidence) {
    node *part[2];
    ball *p = b_array(M);
    HELD(cball, one); HELD(cball, turned); HELD(cball, below); HELD(ball, size); HELD(ball, limit);
    int proved = 1;
    FIELDS(claim, part, "kind");
    FIELDS(evidence, part, "reflections", "parameters");
    size_t count = part[0]->count;
    ball *g = b_array(count);
    b_integer(&limit, 1);
    numbers(g, part[0], count, "reflection coefficients");
    numbers(p, part[1], M, "parameters");
    for (size_t k = 0; k < count; k++) {
        b_set(&size, &g[k]); mpz_abs(size.m, size.m);
        if (!b_less(&size, &limit)) proved = 0;
    }
    for (size_t k = 0; proved && k < N; k++) {
        c_integer(&one, 0);
        for (size_t l = count; l-- > 0;) {
            c_mul(&turned, &one, &zeta[k]); c_scale(&below, &turned, &g[l]);
            b_add(&below.re, &below.re, &limit); b_add(&turned.re, &turned.re, &g[l]);
            c_div(&one, &turned, &below);
        }
        c_scale(&one, &one, &K);
        for (size_t i = 0; i < M; i++) { c_scale(&turned, &functions[k * M + i], &p[i]); c_add(&one, &one, &turned); }
        c_sub(&one, &samples[k], &one); c_abs_above(&size, &one);
        if (!b_at_most(&size, &bounds[k])) proved = 0;
    }
    puts(proved ? "proved: a system of the class keeps every sample within its bound" : "not proved: a system is consistent");
    return proved;
}

/* ---- SHA-256 (FIPS 180-4) of the text of the question. ---- */
static void sha256(const unsigned char *text, size_t size, char hex[65]) {
    static const uint32_t k[64] = {
        0x428a2f98,0x71374491,0xb5c0fbcf,0xe9b5dba5,0x3956c25b,0x59f111f1,0x923f82a4,0xab1c5ed5,0xd807aa98,0x12835b01,0x243185be,0x550c7dc3,0x72be5d74,
        0x80deb1fe,0x9bdc06a7,0xc19bf174,0xe49b69c1,0xefbe4786,0x0fc19dc6,0x240ca1cc,0x2de92c6f,0x4a7484aa,0x5cb0a9dc,0x76f988da,0x983e5152,0xa831c66d,
        0xb00327c8,0xbf597fc7,0xc6e00bf3,0xd5a79147,0x06ca6351,0x14292967,0x27b70a85,0x2e1b2138,0x4d2c6dfc,0x53380d13,0x650a7354,0x766a0abb,0x81c2c92e,
        0x92722c85,0xa2bfe8a1,0xa81a664b,0xc24b8b70,0xc76c51a3,0xd192e819,0xd6990624,0xf40e3585,0x106aa070,0x19a4c116,0x1e376c08,0x2748774c,0x34b0bcb5,
        0x391c0cb3,0x4ed8aa4a,0x5b9cca4f,0x682e6ff3,0x748f82ee,0x78a5636f,0x84c87814,0x8cc70208,0x90befffa,0xa4506ceb,0xbef9a3f7,0xc67178f2};
    uint32_t h[8] = {0x6a09e667,0xbb67ae85,0x3c6ef372,0xa54ff53a,0x510e527f,0x9b05688c,0x1f83d9ab,0x5be0cd19}, w[64], s[8];
    size_t blocks = (size + 9 + 63) / 64;
    unsigned char *padded = room(blocks, 64);
    memcpy(padded, text, size);
    padded[size] = 0x80;
    for (int i = 0; i < 8; i++) padded[blocks * 64 - 1 - (size_t)i] = (unsigned char)((uint64_t)size * 8 >> (8 * i));
    for (size_t b = 0; b < blocks; b++) {
        for (int i = 0; i < 16; i++) {
            const unsigned char *m = padded + b * 64 + 4 * (size_t)i;
            w[i] = (uint32_t)m[0] << 24 | (uint32_t)m[1] << 16 | (uint32_t)m[2] << 8 | m[3];
        }
#define TURN(x, n) ((x) >> (n) | (x) << (32 - (n)))
        for (int i = 16; i < 64; i++)
            w[i] = w[i - 16] + (TURN(w[i - 15], 7) ^ TURN(w[i - 15], 18) ^ w[i - 15] >> 3) + w[i - 7] +
                   (TURN(w[i - 2], 17) ^ TURN(w[i - 2], 19) ^ w[i - 2] >> 10);
        memcpy(s, h, sizeof s);
        for (int i = 0; i < 64; i++) {
            uint32_t one = s[7] + (TURN(s[4], 6) ^ TURN(s[4], 11) ^ TURN(s[4], 25)) + ((s[4] & s[5]) ^ (~s[4] & s[6])) + k[i] + w[i];
            uint32_t two = (TURN(s[0], 2) ^ TURN(s[0], 13) ^ TURN(s[0], 22)) + ((s[0] & s[1]) ^ (s[0] & s[2]) ^ (s[1] & s[2]));
            memmove(s + 1, s, 7 * sizeof *s);
            s[4] += one; s[0] = one + two;
        }
        for (int i = 0; i < 8; i++) h[i] += s[i];
    }
    for (int i = 0; i < 8; i++) snprintf(hex + 8 * i, 9, "%08x", (unsigned)h[i]);
}

/* ---- The file. ---- */
static void read_class(node *one) {
    node *part[3], *matrix[4], *row;
    FIELDS(one, part, "gain_bound", "decay_rate", "functions");
    positive(&K, part[0], "gain_bound");
    positive(&rho, part[1], "decay_rate");
    HELD(ball, unit);
    b_integer(&unit, 1);
    if (!b_less(&unit, &rho)) unreadable("a decay rate that is not above 1", "");
    FIELDS(part[2], matrix, "A", "B", "C", "D");
    S = matrix[0]->count; M = matrix[2]->count;
    if (S > FUNCTIONS || M > FUNCTIONS) unreadable("more parametric functions than version 1 allows", "");
    A = b_array(S * S); B = b_array(S); C = b_array(M * S); D = b_array(M);
    row = list(matrix[0], "A");
    for (size_t a = 0; a < S; a++, row = row->next) numbers(A + a * S, row, S, "a row of A");
    row = list(matrix[2], "C");
    for (size_t i = 0; i < M; i++, row = row->next) numbers(C + i * S, row, S, "a row of C");
    numbers(B, matrix[1], S, "B");
    numbers(D, matrix[3], M, "D");
    about = b_array(M); within = b_array(M);
}
static void read_question(node *part[6]) {
    node *unit[3], *row = list(part[4], "data");
    HELD(ball, level);
    FIELDS(part[2], unit, "frequency", "time", "response");
    if (!is(unit[0], "rad/s") || !is(unit[1], "s")) unreadable("the units of frequency and time must be rad/s and s", "");
    if (unit[2]->kind != 's') unreadable("the unit of the response must be a string", "");
    positive(&sample_time, part[1], "sample_time");
    positive(&level, part[3], "level");
    N = part[4]->count;
    if (!N || N > SAMPLES) unreadable("no data, or more samples than version 1 allows", "");
    read_class(part[0]);
    samples = c_array(N); bounds = b_array(N); zeta = c_array(2 * N + 2); functions = c_array((2 * N + 2) * M);
    if (N <= CACHED) { cauchy = c_array(4 * N * N); known = room(4 * N * N, 1); }
    for (size_t k = 0; k < N; k++, row = row->next) {
        node *child = list_of(row, 4, "a sample [omega, re, im, bound]");
        place(k, N + k, child);
        number(&samples[k].re, child->next); number(&samples[k].im, child->next->next);
        positive(&bounds[k], child->next->next->next, "bound of a sample");
        b_mul(&bounds[k], &bounds[k], &level);
    }
}
int main(int count, char **words_of) {
    node *part[5], *asked[6], *proof[2], *claim, *evidence;
    FILE *file = count == 2 ? fopen(words_of[1], "rb") : NULL;
    char hex[65];
    if (!file) unreadable(count == 2 ? "cannot open" : "usage: robustid-proof FILE", count == 2 ? words_of[1] : "");
    long length = fseek(file, 0, SEEK_END) ? -1 : ftell(file);
    if (length < 0 || length > LARGEST || fseek(file, 0, SEEK_SET)) unreadable("no file of at most 64 MiB", words_of[1]);
    char *text = room((size_t)length, 1);
    size_t size = fread(text, 1, (size_t)length, file);
    fclose(file);
    ball *made[] = {&B1, &B2, &B3, &B4, &C1.re, &C1.im, &C2.re, &C2.im, &K, &rho, &sample_time};
    mpz_inits(T1, T2, T3, NULL);
    for (size_t k = 0; k < sizeof made / sizeof *made; k++) ball_init(made[k]);
    at = text; stop = text + size;
    node *whole = value(0);
    blank();
    if (at != stop) unreadable("something follows after the proof", "");
    FIELDS(whole, part, "format", "version", "digest", "question", "evidence");
    if (!is(part[0], "robustid-proof") || part[1]->kind != 'i' || index_below(part[1], 1000) != 1) unreadable("this is not version 1 of robustid-proof", "");
    FIELDS(part[3], asked, "class", "sample_time", "units", "level", "data", "statements");
    FIELDS(part[4], proof, "parameters", "statements");
    sha256((const unsigned char *)part[3]->start, (size_t)(part[3]->end - part[3]->start), hex);
    if (!is(part[2], hex)) { printf("not proved: the digest is not that of the question, %s\n", hex); return 1; }
    claim = list(asked[5], "statements");
    evidence = list_of(proof[1], asked[5]->count, "evidence of every statement");
    if (!claim) unreadable("there are no statements", "");
    for (node *one = evidence; one; one = one->next) { /* two bits for every step of the recursion of a system */
        node *gains = one->kind == 'o' ? find(one, "reflections") : NULL;
        if (gains && gains->count > TERMS) unreadable("more reflection coefficients than version 1 allows", "");
        if (gains && precision < 256 + 2 * gains->count) precision = 256 + 2 * gains->count;
    }
    read_question(asked);
    int sound, proved = 1;
    printf("question %s: %zu samples, %zu parametric functions, bounds times ", hex, N, M); words(asked[3]); putchar('\n');
    sound = parameters_proved(proof[0]) && !lost;
    if (!sound) { puts("not proved: what the evidence says of the parameters, on which all statements stand"); return 1; }
    for (; claim; claim = claim->next, evidence = evidence->next) {
        node *kind = claim->kind == 'o' ? find(claim, "kind") : NULL;
        if (!kind) unreadable("a statement without a kind", "");
        lost = 0;
        int own = is(kind, "disc") ? by_sums('d', claim, evidence) : is(kind, "support") ? by_sums('s', claim, evidence)
            : is(kind, "inconsistent") ? by_sums('i', claim, evidence) : is(kind, "consistent") ? consistent(claim, evidence) : -1;
        if (own < 0) unreadable("a kind of statement that version 1 does not know", "");
        if (!own || lost) proved = 0;
    }
    puts(proved ? "all statements are proved" : "not all statements are proved");
    return proved ? 0 : 1;
}
