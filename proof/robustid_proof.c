/* robustid-proof FILE: check a proof of what finitely many samples say about all systems of a class.
 * The format, and the mathematics of every step, are in docs/proof_format.rst; the names here are those of that page. Every number is
 * a disc of the complex plane, an integer middle and an integer radius in units of 2^-P; rounding only widens it.
 * Exit status: 0 every statement is proved, 1 one is not, 2 the file cannot be read. Build: cc -O2 -o robustid-proof robustid_proof.c -lgmp
 */
#include <gmp.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
enum { DEPTH = 16, TEXT = 400, DYADIC = 4000, DECIMAL = 400, LARGE = 40000, CACHED = 200, /* what a file may ask for */
       SAMPLES = 20000, FUNCTIONS = 64, TERMS = 4096, LARGEST = 256 << 20 };
static void unreadable(const char *why, const char *what) {
    printf("not readable: %s%s%s\n", why, *what ? ": " : "", what);
    exit(2);
}
static void *room(size_t count, size_t size) {
    void *found = calloc(count ? count : 1, size);
    if (!found) unreadable("not enough memory", "");
    return found;
}

/* ---- Numbers. `lost` is set where a result has no bound: a division by what may be 0, or numbers out of range. HELD ones are made once. ---- */
typedef struct { mpz_t re, im, r; } num;
static unsigned long P = 320;
static int lost;
static mpz_t T1, T2, T3;
static num ONE, NONE;
static num *array(size_t count) {
    num *found = room(count, sizeof *found);
    for (size_t k = 0; k < count; k++) mpz_inits(found[k].re, found[k].im, found[k].r, NULL);
    return found;
}
static void release(num *x, size_t count) { for (size_t k = 0; k < count; k++) mpz_clears(x[k].re, x[k].im, x[k].r, NULL); free(x); }
#define HELD(x) static num x; static int x##_; if (!x##_) { mpz_inits(x.re, x.im, x.r, NULL); x##_ = 1; }
static void set(num *z, const num *x) { mpz_set(z->re, x->re); mpz_set(z->im, x->im); mpz_set(z->r, x->r); }
static void integer(num *z, long value) { mpz_set_si(z->re, value); mpz_mul_2exp(z->re, z->re, P); mpz_set_ui(z->im, 0); mpz_set_ui(z->r, 0); }
static int zero(const num *x) { return !mpz_sgn(x->re) && !mpz_sgn(x->im) && !mpz_sgn(x->r); }
static void mirrored(num *z, const num *x) { if (z != x) set(z, x); mpz_neg(z->im, z->im); }
static void add(num *z, const num *x, const num *y) { mpz_add(z->re, x->re, y->re); mpz_add(z->im, x->im, y->im); mpz_add(z->r, x->r, y->r); }
static void sub(num *z, const num *x, const num *y) { mpz_sub(z->re, x->re, y->re); mpz_sub(z->im, x->im, y->im); mpz_add(z->r, x->r, y->r); }
/* To a sum in units of 2^-2P: x y, or x y* where `turned`. The error of a product is at most |x| r_y + (|y| + r_y) r_x. */
static void accumulate(num *sum, const num *x, const num *y, int turned) {
    mpz_addmul(sum->re, x->re, y->re); mpz_addmul(sum->im, x->im, y->re);
    (turned ? mpz_addmul : mpz_submul)(sum->re, x->im, y->im); (turned ? mpz_submul : mpz_addmul)(sum->im, x->re, y->im);
    if (!mpz_sgn(x->r) && !mpz_sgn(y->r)) return;
    mpz_abs(T1, x->re); mpz_abs(T2, x->im); mpz_add(T1, T1, T2); mpz_addmul(sum->r, T1, y->r);
    mpz_abs(T1, y->re); mpz_abs(T2, y->im); mpz_add(T1, T1, T2); mpz_add(T1, T1, y->r); mpz_addmul(sum->r, T1, x->r);
}
static void settle(num *z, num *sum) { /* the sum in units of 2^-P; it begins anew */
    mpz_fdiv_q_2exp(z->re, sum->re, P); mpz_fdiv_q_2exp(z->im, sum->im, P); mpz_cdiv_q_2exp(z->r, sum->r, P);
    if (!mpz_divisible_2exp_p(sum->re, P) || !mpz_divisible_2exp_p(sum->im, P)) mpz_add_ui(z->r, z->r, 2);
    if (mpz_sizeinbase(z->re, 2) > LARGE || mpz_sizeinbase(z->im, 2) > LARGE || mpz_sizeinbase(z->r, 2) > LARGE) { lost = 1; integer(z, 0); }
    integer(sum, 0);
}
static void times(num *z, const num *x, const num *y, int turned) { HELD(sum); accumulate(&sum, x, y, turned); settle(z, &sum); }
static void mul(num *z, const num *x, const num *y) { times(z, x, y, 0); }
static void over(num *z, const num *x, unsigned long k) { /* by a positive integer */
    mpz_fdiv_q_ui(z->re, x->re, k); mpz_fdiv_q_ui(z->im, x->im, k); mpz_cdiv_q_ui(z->r, x->r, k); mpz_add_ui(z->r, z->r, 2);
}
static void divide(num *z, const num *x, const num *y) { /* |1/x - 1/y| <= r/(|y| (|y| - r)) for |x - y| <= r */
    HELD(by); mpz_mul(T1, y->re, y->re); mpz_addmul(T1, y->im, y->im); mpz_sqrt(T2, T1); mpz_sub(T2, T2, y->r);
    if (mpz_sgn(T2) <= 0) { lost = 1; integer(z, 0); return; }
    mpz_mul_2exp(T3, y->r, 2 * P); mpz_mul(T2, T2, T2); mpz_cdiv_q(by.r, T3, T2);
    mpz_mul_2exp(T3, y->re, 2 * P); mpz_fdiv_q(by.re, T3, T1);
    mpz_mul_2exp(T3, y->im, 2 * P); mpz_fdiv_q(by.im, T3, T1); mpz_neg(by.im, by.im);
    mpz_add_ui(by.r, by.r, 2); mul(z, x, &by);
}
static void exactly(num *z) { mpz_add(z->re, z->re, z->r); mpz_set_ui(z->im, 0); mpz_set_ui(z->r, 0); } /* not below a real number */
static void above(num *z, const num *x) { /* not below |x| */
    mpz_mul(T1, x->re, x->re); mpz_addmul(T1, x->im, x->im); mpz_sqrtrem(z->re, T2, T1);
    if (mpz_sgn(T2)) mpz_add_ui(z->re, z->re, 1);
    mpz_set(z->r, x->r); exactly(z);
}
static void root(num *z, const num *x) { /* not below the root of x; 0 of negative ones */
    if (z != x) set(z, x);
    exactly(z); if (mpz_sgn(z->re) <= 0) { integer(z, 0); return; }
    mpz_mul_2exp(z->re, z->re, P); mpz_sqrt(z->re, z->re); mpz_add_ui(z->re, z->re, 1);
}
static void charge(num *z, const num *x, const num *y) { HELD(one); above(&one, x); mul(&one, &one, y); add(z, z, &one); } /* |x| y more */
static int at_most(const num *x, const num *y) { HELD(d); sub(&d, y, x); return !lost && mpz_cmp(d.re, d.r) >= 0; }
static int less(const num *x, const num *y) { HELD(d); sub(&d, y, x); return !lost && mpz_cmp(d.re, d.r) > 0; }
static int positive(const num *x) { return !lost && mpz_cmp(x->re, x->r) > 0; }
static void turn(num *z, const num *x) { /* exp(-j x), 0 <= x < 4: from k = 8 on terms that are left out are together at most the last one */
    HELD(term); HELD(by); HELD(size); integer(&by, 0); mpz_neg(by.im, x->re); mpz_set(by.r, x->r); integer(&term, 1); integer(z, 1);
    for (unsigned long k = 1; k <= 8 || (mpz_sizeinbase(size.re, 2) >= 16 && !lost); k++) {
        mul(&term, &term, &by); over(&term, &term, k); add(z, z, &term); above(&size, &term);
    }
    mpz_add(z->r, z->r, size.re);
}
/* ---- Text: JSON in printable ASCII, without escapes; objects with exactly the keys that are expected. ---- */
typedef struct node { char kind; const char *start, *end; size_t count; struct node *key, *child, *next; } node;
static const char *at; /* the text ends with a zero byte, which no value holds */
static void blank(void) { at += strspn(at, " \n\r\t"); }
static void expect(char c) { if (*at != c) { char s[2] = {c, 0}; unreadable("something else where there must be", s); } at++; }
static int is(const node *one, const char *text) {
    size_t size = strlen(text);
    return one->kind == 's' && (size_t)(one->end - one->start) == size && !memcmp(one->start, text, size);
}
static node *value(int depth) {
    node *found = room(1, sizeof *found), **last = &found->child;
    if (depth > DEPTH) unreadable("too deeply nested", "");
    blank(); found->start = at;
    found->kind = *at == '"' ? 's' : *at == '{' ? 'o' : *at == '[' ? 'a' : 'i';
    if (found->kind == 'i') {
        found->end = at += strspn(at, "0123456789");
        size_t figures = (size_t)(at - found->start);
        if (!figures || figures > 9 || (figures > 1 && *found->start == '0')) unreadable("no string, list or object, nor a plain index", "");
        return found;
    }
    at++;
    if (found->kind == 's') {
        for (found->start = at; *at >= 0x20 && *at <= 0x7e && *at != '\\' && *at != '"';) at++;
        found->end = at; expect('"');
        if (found->end - found->start > TEXT) unreadable("a string that is too long", "");
        return found;
    }
    char end = found->kind == 'o' ? '}' : ']';
    for (blank(); found->count || *at != end; at++) {
        node *key = end == '}' ? value(depth + 1) : NULL;
        if (key && key->kind != 's') unreadable("a key that is no string", "");
        if (key) { blank(); expect(':'); }
        *last = value(depth + 1); (*last)->key = key;
        last = &(*last)->next; found->count++; blank();
        if (*at != ',') break;
    }
    expect(end); found->end = at;
    return found;
}
static node *find(const node *object, const char *key) { node *one = object->child; while (one && !is(one->key, key)) one = one->next; return one; }
static void fields(const node *object, const char *keys[], size_t count, node *found[]) { /* all of them, so none twice */
    if (object->kind != 'o' || object->count != count) unreadable("an object has other keys than it must; one must be", keys[0]);
    for (size_t k = 0; k < count; k++) if (!(found[k] = find(object, keys[k]))) unreadable("a key is missing", keys[k]);
}
#define FIELDS(object, found, ...) do { const char *keys_[] = {__VA_ARGS__}; fields(object, keys_, sizeof keys_ / sizeof *keys_, found); } while (0)
static node *list(node *one, const char *what) { if (one->kind != 'a') unreadable("there must be a list", what); return one->child; }
static node *list_of(node *one, size_t count, const char *what) { if (one->count != count) unreadable("a list of another length", what); return list(one, what); }
static size_t index_below(const node *one, size_t limit) {
    size_t found = one->kind == 'i' ? strtoul(one->start, NULL, 10) : limit;
    if (found >= limit) unreadable("an index out of range, or none", "");
    return found;
}
static void number(num *z, const node *one) { /* "-12.5e-3" or "-123p-60", an integer times a power of two */
    static const char *bad = "there must be a number in a string, as \"-1.5e-3\" or \"-123p-60\"", *figures = "0123456789";
    if (one->kind != 's') unreadable(bad, "");
    char digits[TEXT + 1], *end;
    const char *s = one->start + (*one->start == '-'); /* what follows the string is a quotation mark */
    size_t whole = strspn(s, figures), part = s[whole] == '.' ? strspn(s + whole + 1, figures) : 0;
    const char *after = s + whole + (part ? part + 1 : 0);
    int dyadic = *after == 'p';
    long exponent = 0;
    if (dyadic || *after == 'e') {
        size_t count = strspn(after + 1 + (after[1] == '-' || after[1] == '+'), figures);
        if (!count || count > 4) unreadable(bad, "");
        exponent = strtol(after + 1, &end, 10);
        after = end;
    }
    if (!whole || (dyadic && part) || after != one->end || labs(exponent) > (dyadic ? DYADIC : DECIMAL)) unreadable(bad, "");
    memcpy(digits, s, whole); memcpy(digits + whole, s + whole + 1, part);
    digits[whole + part] = 0; exponent -= (long)part;
    integer(z, 0); mpz_set_str(z->re, digits, 10);
    mpz_ui_pow_ui(T1, dyadic ? 2 : 10, (unsigned long)labs(exponent));
    mpz_mul_2exp(z->re, z->re, P);
    if (exponent >= 0) mpz_mul(z->re, z->re, T1);
    else { mpz_set_ui(z->r, !mpz_divisible_p(z->re, T1)); mpz_fdiv_q(z->re, z->re, T1); }
    if (s != one->start) mpz_neg(z->re, z->re);
}
static void above_zero(num *z, const node *one, const char *what) { number(z, one); if (!positive(z)) unreadable("a number that must be positive", what); }
static void complex(num *z, const node *re) { /* and the next value, the imaginary part */
    HELD(im); number(z, re); number(&im, re->next);
    mpz_set(z->im, im.re); mpz_add(z->r, z->r, im.r);
}
static void pair(num *z, node *one) { complex(z, list_of(one, 2, "a complex number [re, im]")); }
static void numbers(num *z, node *one, size_t count, const char *what) { for (one = list_of(one, count, what); one; one = one->next) number(z++, one); }
static size_t term(num *z, node *row, size_t limit) { /* of a row [k, re, im] the index, and the number */
    complex(z, list_of(row, 3, "a row [k, re, im]")->next);
    return index_below(row->child, limit);
}
static node *terms(node *one) { if (one->count > TERMS) unreadable("too many rows [k, re, im]", ""); return list(one, "rows [k, re, im]"); }

/* ---- Vectors: of functionals sum c_k phi(zeta_k) + sum c_s phi_s, and of functions sum c_k/(1 - zeta zeta_k*) + sum c_s zeta^s. Nodes
 * 0..N-1 are those of the lines, N..2N-1 their conjugates, 2N and 2N+1 those of a statement; then come `powers` coefficients. ---- */
static size_t N, M, R, nodes, powers, longest; /* lines, parametric functions, samples of records; coefficients, those that these see */
static num K, rho, sample_time, *zeta, *cauchy;
static char *ready;
static const num *kernel(size_t k, size_t l) { /* 1/(1 - zeta_k zeta_l*), kept until a node moves */
    HELD(one); num *z = cauchy ? cauchy + nodes * k + l : &one;
    if (cauchy && ready[nodes * k + l]) return z;
    times(z, &zeta[k], &zeta[l], 1);
    sub(z, &ONE, z); divide(z, &ONE, z);
    if (cauchy && !lost) { mirrored(cauchy + nodes * l + k, z); ready[nodes * k + l] = ready[nodes * l + k] = 1; }
    return z;
}
static size_t length(const num *c) { size_t top = powers; while (top && zero(c + nodes + top - 1)) top--; return top; }
static size_t twin(size_t k) { return k < 2 * N ? (k + N) % (2 * N) : k < nodes ? 4 * N + 1 - k : k; } /* of the conjugate */
static int is_real(const num *c) { /* the same at conjugate nodes */
    HELD(d); int same = 1;
    for (size_t k = 0; same && k < nodes + powers; k++) {
        mirrored(&d, c + twin(k)); sub(&d, c + k, &d); same = !mpz_sgn(d.re) && !mpz_sgn(d.im) && !mpz_cmp(c[k].r, c[twin(k)].r);
    }
    return same;
}
static void values(num *out, const num *in, const num *also) { /* of a function, where it or `also` is not 0 */
    HELD(sum); HELD(one); size_t own = length(in), top = length(also) > own ? length(also) : own; int real = is_real(in);
    for (size_t k = 0; k < nodes; k++) {
        if (zero(in + k) && zero(also + k)) continue;
        if (real && !zero(out + twin(k))) { mirrored(out + k, out + twin(k)); continue; }
        for (size_t l = 0; l < nodes; l++) if (!zero(in + l)) accumulate(&sum, kernel(k, l), in + l, 0);
        settle(out + k, &sum); integer(&one, 0);
        for (size_t s = own; s-- > 0;) { mul(&one, &one, &zeta[k]); add(&one, &one, in + nodes + s); }
        add(out + k, out + k, &one);
    }
    for (size_t s = 0; s < top; s++) set(out + nodes + s, in + nodes + s);
    for (size_t l = 0; top && l < nodes; l++) {
        if (zero(in + l)) continue;
        set(&one, in + l);
        for (size_t s = 0; s < top; s++) { add(out + nodes + s, out + nodes + s, &one); times(&one, &one, &zeta[l], 1); }
    }
}
static void size_of(num *z, const num *x, const num *y, size_t count) { /* above the root of sum x_k y_k*: x = y, or values of y */
    HELD(sum);
    for (size_t k = 0; k < count; k++) if (!zero(y + k)) accumulate(&sum, x + k, y + k, 1);
    settle(z, &sum); root(z, z);
}
/* Above the norm of a functional in H2 seen from `base`: that of the representer of what it is of (1 - base* zeta) phi, scaled. */
static void norm(num *z, const num *c, const num *base) {
    HELD(one); HELD(scale); num *f = array(nodes + powers), *at = array(nodes + powers);
    for (size_t k = 0; k < nodes + powers; k++) {
        if (k < nodes) { times(&one, &zeta[k], base, 1); mul(&one, &one, c + k); }
        else times(&one, k + 1 < nodes + powers ? c + k + 1 : &NONE, base, 1);
        sub(f + k, c + k, &one); mirrored(f + k, f + k);
    }
    values(at, f, f); size_of(z, at, f, nodes + powers);
    times(&scale, base, base, 1); sub(&scale, &ONE, &scale);
    if (!positive(&scale)) { lost = 1; return; }
    divide(&scale, &ONE, &scale); root(&scale, &scale); mul(z, z, &scale); exactly(z);
    release(f, nodes + powers); release(at, nodes + powers);
}
/* Takes from a functional what (f, g) is, <phi g, f>, and adds to `cost` what that costs: |f| |g|. */
static void factor(num *cost, num *c, node *evidence) {
    HELD(size); HELD(one); node *side[2], *row; num *v[2], *at[2]; size_t all = nodes + powers, top;
    FIELDS(evidence, side, "f", "g");
    for (int k = 0; k < 2; k++) {
        v[k] = array(all); at[k] = array(all);
        for (row = terms(side[k]); row; row = row->next) { size_t l = term(&one, row, all); add(v[k] + l, v[k] + l, &one); }
    }
    values(at[0], v[0], v[0]); values(at[1], v[1], v[0]);
    size_of(&size, at[0], v[0], all); size_of(&one, at[1], v[1], all); mul(&size, &size, &one); add(cost, cost, &size);
    top = length(v[0]);
    for (size_t k = 0; k < nodes; k++) if (!zero(v[0] + k)) { times(&one, at[1] + k, v[0] + k, 1); sub(c + k, c + k, &one); }
    for (size_t s = 0; s < top; s++) for (size_t m = 0; m <= s; m++) { /* <phi g, zeta^s> = sum g_m phi_(s-m) */
        times(&one, at[1] + nodes + m, v[0] + nodes + s, 1); sub(c + nodes + s - m, c + nodes + s - m, &one);
    }
    for (int k = 0; k < 2; k++) { release(v[k], all); release(at[k], all); }
}

/* ---- Known functions C (z - A)^-1 B + D of one input: m of them with n states; R = (z - A)^-1 and x = R B at the last z. ---- */
typedef struct { size_t n, m; num *A, *B, *C, *D, *R, *x, *y, *off; } known;
static void read_known(known *f, node *one) {
    node *part[4];
    FIELDS(one, part, "A", "B", "C", "D");
    size_t n = f->n = part[0]->count, m = f->m = part[2]->count;
    if (n > FUNCTIONS || m > FUNCTIONS) unreadable("more functions, or states of them, than version 1 allows", "");
    num *a = f->A = array(n * n), *c = f->C = array(m * n);
    f->B = array(n); f->D = array(m); f->R = array(n * n); f->x = array(n); f->y = array(n); f->off = array(m + 2);
    for (node *row = list(part[0], "A"); row; row = row->next, a += n) numbers(a, row, n, "a row of A");
    for (node *row = list(part[2], "C"); row; row = row->next, c += n) numbers(c, row, n, "a row of C");
    numbers(f->B, part[1], n, "B"); numbers(f->D, part[3], m, "D");
}
static void product(num *out, const num *x, const num *y, size_t rows, size_t count, size_t columns) { /* of matrices */
    HELD(sum);
    for (size_t a = 0; a < rows; a++) for (size_t b = 0; b < columns; b++) {
        for (size_t k = 0; k < count; k++) accumulate(&sum, x + a * count + k, y + k * columns + b, 0);
        settle(out + a * columns + b, &sum);
    }
}
static void resolve(const known *f, const num *z) { /* by elimination in place; a pivot that may be 0 proves nothing */
    HELD(one); HELD(pivot); num *m = f->R; size_t n = f->n;
    for (size_t a = 0; a < n * n; a++) { if (a % (n + 1)) integer(m + a, 0); else set(m + a, z); sub(m + a, m + a, f->A + a); }
    for (size_t p = 0; p < n; p++) {
        num *low = m + p * n;
        set(&pivot, low + p); integer(low + p, 1);
        for (size_t b = 0; b < n; b++) if (!zero(low + b)) divide(low + b, low + b, &pivot);
        for (size_t a = 0; a < n; a++) {
            num *high = m + a * n;
            if (a == p || zero(high + p)) continue;
            set(&pivot, high + p); integer(high + p, 0);
            for (size_t b = 0; b < n; b++) { mul(&one, &pivot, low + b); sub(high + b, high + b, &one); }
        }
    }
    product(f->x, m, f->B, n, n, 1);
}
static void respond(num *out, const known *f, const num *z) { /* the values at z */
    resolve(f, z); product(out, f->C, f->x, f->m, f->n, 1);
    for (size_t i = 0; i < f->m; i++) add(out + i, out + i, f->D + i);
}
static void bends(const known *f, const num *z, const num *d) { /* of |f'| + |f''|: |C R| |R B| (g^2 + 2 |R| g^3) */
    HELD(size); HELD(g); HELD(one); size_t n = f->n;
    resolve(f, z); size_of(&size, f->R, f->R, n * n);
    mul(&g, d, &size); sub(&g, &ONE, &g);
    if (!positive(&g)) lost = 1;
    divide(&g, &ONE, &g); exactly(&g);
    mul(&one, &size, &g); add(&one, &one, &one); add(&one, &one, &ONE); mul(&size, &g, &g); mul(&g, &size, &one);
    size_of(&one, f->x, f->x, n); mul(&g, &g, &one);
    for (size_t i = 0; i < f->m; i++) { product(f->y, f->C + i * n, f->R, 1, n, n); size_of(&one, f->y, f->y, n); mul(f->off + i, &g, &one); exactly(f->off + i); }
}
static int stable(const known *f, const num *power, int more) { /* A^(2^k), k < 40, is a contraction */
    HELD(size); size_t n = f->n; num *square = array(n * n); size_of(&size, power, power, n * n);
    int found = less(&size, &ONE);
    if (!found && more) { product(square, power, power, n, n, n); found = stable(f, square, more - 1); }
    release(square, n * n);
    return found;
}

/* ---- The question: lines and their conjugates, then samples of records. ---- */
static num *samples, *bounds, *functions, *about, *within, *decay; /* functions: M a node, and the responses at samples of records */
/* A mode c n(x)/(1 - a x), its pole a in a region around `poles`: their functions from number `first` on, each before its conjugate. */
typedef struct { size_t first, degree, terms; num *numerator, *poles, *sizes, *reach, *beyond; } mode;
static mode *modes, *modes_end;
static num corner, kappa; /* of continuous time: z = (corner + s)/(corner - s), kappa = alpha/corner; else 0 */
static num *target, *wanted; /* the functional of a statement: target_0 F(2N) + target_1 F(2N + 1) + sum wanted_i p_i */
static struct { num *u; size_t t; } *record;
static known parametric;
static num here; /* z of the frequency that was placed last */
static void read_modes(node *one) {
    HELD(x); HELD(inside); HELD(scale); node *part[3], *row = list(one, "modes"); modes = modes_end = room(one->count, sizeof *modes);
    for (; row; row = row->next, modes_end++) {
        mode *m = modes_end;
        FIELDS(row, part, "numerator", "poles", "reach");
        m->first = M; m->degree = part[0]->count; m->terms = part[1]->count; M += 2 * m->terms;
        if (!m->terms || M > 4 * FUNCTIONS || m->degree > FUNCTIONS) unreadable("a mode of no pole, or too many of them", "");
        m->numerator = array(m->degree); m->poles = array(m->terms); m->reach = array(m->terms); m->sizes = array(m->terms);
        numbers(m->numerator, part[0], m->degree, "a numerator"); numbers(m->reach, part[2], m->terms, "a reach for every pole");
        one = list(part[1], "poles");
        for (size_t j = 0; j < m->terms; j++, one = one->next) {
            pair(m->poles + j, one); times(&inside, m->poles + j, m->poles + j, 1); sub(&inside, &ONE, &inside);
            if (!positive(&inside) || !positive(m->reach + j) || !less(m->reach, &ONE)) unreadable("a pole that is not inside the circle", "");
            if (!j) { mul(&x, m->reach, m->reach); sub(&x, &ONE, &x); mul(&scale, &x, &inside); continue; }
            divide(&x, &inside, &scale); root(&x, &x); mul(m->sizes + j, m->reach + j - 1, &x); /* above |C_j/C_1| */
        }
        m->beyond = array(1); sub(&x, &ONE, m->reach); divide(m->beyond, m->reach + m->terms - 1, &x); exactly(m->beyond);
    }
}
static void respond_modes(num *out, const num *x) { /* n(x) b_1 ... b_(j-1)/(1 - a_j x), b = (x - a*)/(1 - a x), and with a* in place of a */
    HELD(value); HELD(a); HELD(one);
    for (const mode *m = modes; m < modes_end; m++) for (size_t k = 0; k < 2 * m->terms; k++) {
        size_t turned = k >= m->terms, j = k % m->terms;
        if (!j) integer(&value, 0);
        for (size_t s = j ? 0 : m->degree; s-- > 0;) { mul(&value, &value, x); add(&value, &value, m->numerator + s); }
        num *z = out + m->first + 2 * j + turned;
        set(&a, m->poles + j); if (turned) mirrored(&a, &a);
        mul(&one, &a, x); sub(&one, &ONE, &one); divide(z, &value, &one);
        mirrored(&a, &a); sub(&one, x, &a); mul(&value, z, &one);
    }
}
static void spread(num *z, const num *values) { /* what the modes have beyond their terms, more */
    for (const mode *m = modes; m < modes_end; m++) for (int k = 0; k < 2; k++) charge(z, values + m->first + k, m->beyond);
}
static void place(size_t k, size_t conjugate, const node *omega) { /* zeta and the functions at exp(j omega T) and its conjugate */
    HELD(x); integer(&here, -1);
    if (!is(omega, "half")) {
        number(&x, omega); mul(&x, &x, &sample_time); mpz_fdiv_q_2exp(T1, x.re, P);
        if (mpz_cmp(x.re, x.r) < 0 || (zero(&corner) && mpz_cmp_ui(T1, 4) >= 0)) unreadable("a frequency that is negative, or far above half the sample rate", "");
        if (zero(&corner)) turn(&here, &x);
        else { set(&here, &corner); mpz_set(here.im, x.re); mpz_add(here.r, here.r, x.r); mirrored(&x, &here); divide(&here, &x, &here); }
    }
    mul(&x, &kappa, &here); add(&x, &x, &rho); divide(&zeta[k], &here, &x); mirrored(&zeta[conjugate], &zeta[k]);
    for (size_t l = 0; cauchy && l < nodes; l++) ready[nodes * k + l] = ready[nodes * l + k] = ready[nodes * conjugate + l] = ready[nodes * l + conjugate] = 0;
    respond_modes(functions + k * M, &here); mirrored(&here, &here); respond(functions + k * M, &parametric, &here);
    for (size_t i = 0, F = parametric.m; i < M; i++) mirrored(functions + conjugate * M + (i < F ? i : F + ((i - F) ^ 1)), functions + k * M + i);
}

/* ---- The sums. ---- */
static void sums(num *centre, num *radius, num *leak, node *evidence) { /* the disc of all consistent systems; `leak`: of parameters */
    HELD(base); HELD(d); HELD(one); HELD(size); HELD(cost); node *part[3], *row; num *c = array(nodes + powers), *missed = array(M);
    FIELDS(evidence, part, "base", "factors", "multipliers");
    pair(&base, part[0]);
    integer(centre, 0); integer(radius, 0); integer(leak, 0); integer(&cost, 0);
    for (size_t i = 0; i < M; i++) sub(missed + i, missed + i, wanted + i); /* missed = sum d_k P_i(k) - its target */
    for (size_t k = 0; k < 2; k++) if (!zero(target + k)) {
        const num *own = functions + (2 * N + k) * M;
        for (size_t i = 0; i < M; i++) { mul(&one, target + k, own + i); sub(missed + i, missed + i, &one); }
        set(c + 2 * N + k, target + k); integer(&one, 0); spread(&one, own); charge(radius, target + k, &one);
    }
    for (row = terms(part[2]); row; row = row->next) {
        size_t k = term(&d, row, 2 * N + R), own = k < 2 * N ? k % N : k - N, at = k < 2 * N ? k : k + 2;
        times(&one, &d, samples + own, k >= N && k < 2 * N); /* the conjugate sample: F* at the conjugate node */
        add(centre, centre, &one); charge(radius, &d, bounds + own);
        if (k < 2 * N) sub(c + k, c + k, &d);
        for (size_t s = 0; k >= 2 * N && s <= record[k - 2 * N].t; s++) {
            mul(&one, record[k - 2 * N].u + record[k - 2 * N].t - s, decay + s); mul(&one, &one, &d);
            sub(c + nodes + s, c + nodes + s, &one);
        }
        for (size_t i = 0; i < M; i++) { mul(&one, &d, functions + at * M + i); add(missed + i, missed + i, &one); }
    }
    if (M && !positive(within)) lost = 1; /* nothing is proved of the parameters */
    for (size_t i = 0; i < M; i++) { mul(&one, missed + i, about + i); sub(centre, centre, &one); charge(leak, missed + i, within + i); }
    for (row = list(part[1], "factors"); row; row = row->next) factor(&cost, c, row);
    norm(&size, c, &base); add(&cost, &cost, &size); mul(&cost, &cost, &K);
    add(radius, radius, &cost); add(radius, radius, leak); exactly(radius); exactly(leak);
    release(c, nodes + powers); release(missed, M);
}
static int parameters_proved(node *evidence) { /* b + E u <= u and E u < u for the stated distances u */
    HELD(centre); HELD(radius); HELD(leak); node *part[3], *row; int proved = 1;
    FIELDS(evidence, part, "centre", "radius", "combinations");
    if (M && !list(part[0], "centres") && !list(part[1], "radii") && !list(part[2], "combinations")) return 1;
    size_t F = parametric.m, count = F + (size_t)(modes_end - modes);
    node *centres = list_of(part[0], count, "centres of the parameters"), *radii = list_of(part[1], count, "radii of the parameters");
    row = list_of(part[2], count, "combinations of the parameters");
    for (size_t i = 0; i < F; i++, centres = centres->next, radii = radii->next) { number(about + i, centres); number(within + i, radii); }
    for (mode *m = modes; m < modes_end; m++, centres = centres->next, radii = radii->next) { /* the amplitude and its conjugate */
        pair(about + m->first, centres); mirrored(about + m->first + 1, about + m->first);
        number(within + m->first, radii); set(within + m->first + 1, within + m->first);
        above(&radius, about + m->first); add(&radius, &radius, within + m->first); mul(m->beyond, m->beyond, &radius);
        for (size_t j = 2; j < 2 * m->terms; j++) mul(within + m->first + j, m->sizes + j / 2, &radius);
    }
    for (size_t k = 0; k < N; k++) spread(bounds + k, functions + k * M);
    for (size_t k = 0; k < count; k++, row = row->next) {
        size_t i = k < F ? k : modes[k - F].first;
        integer(wanted + i, 1); sums(&centre, &radius, &leak, row); integer(wanted + i, 0); sub(&centre, &centre, about + i);
        if (k < F) mpz_set_ui(centre.im, 0); /* a real parameter */
        above(&centre, &centre); add(&radius, &radius, &centre);
        if (!positive(within + i) || !at_most(&radius, within + i) || !less(&leak, within + i)) proved = 0;
    }
    return proved;
}

/* ---- The statements. ---- */
static void words(const node *one, const char *after) { fwrite(one->start, 1, (size_t)(one->end - one->start), stdout); fputs(after, stdout); }
/* disc: |F - centre| <= radius; support: Re(direction F) <= value; inconsistent: no system, since the disc of the functional 0 does not hold 0. */
static int by_sums(node *claim, node *evidence) {
    HELD(centre); HELD(stated); HELD(radius); HELD(leak); HELD(limit); node *part[4]; char kind = *find(claim, "kind")->start;
    integer(target, kind != 'i'); integer(target + 1, 0);
    if (kind == 'i') {
        FIELDS(claim, part, "kind"); sums(&centre, &radius, &leak, evidence);
        mul(&radius, &radius, &radius); times(&limit, &centre, &centre, 1);
        int none = less(&radius, &limit);
        puts(none ? "proved: no system of the class keeps every sample within its bound" : "not proved: no system is consistent");
        return none;
    }
    FIELDS(claim, part, "kind", "omega", kind == 's' ? "direction" : "centre", kind == 's' ? "value" : "radius");
    place(2 * N, 2 * N + 1, part[1]);
    pair(&stated, part[2]); number(&limit, part[3]);
    if (kind == 's') { over(target, &stated, 2); mirrored(target + 1, target); } /* Re(u F) = (u F + u* F*)/2 */
    sums(&centre, &radius, &leak, evidence);
    if (kind == 'd') { sub(&centre, &centre, &stated); above(&centre, &centre); } /* else the functional is real */
    exactly(&centre); add(&radius, &radius, &centre);
    int proved = at_most(&radius, &limit);
    printf("%s%s", proved ? "proved: " : "not proved: ", kind == 's' ? "Re((" : "|F - (");
    words(part[2]->child, " + "); words(part[2]->child->next, kind == 's' ? " j) F) <= " : " j)| <= ");
    words(part[3], " at "); words(part[1], " rad/s, for every consistent system\n");
    return proved;
}

/* ---- Arcs: known functions a, b, c, and F in a disc at every knot; between two knots a + b F is near the chord of its discs. ---- */
typedef struct { num z, known[4], value, radius; } knot; /* a, b, c, and the centre of a + b F; the disc of F; the radius of a + b F */
/* Of modes |d2/dt2 F| <= A t sum |n_k| ((k + h)^2 + h^2 + h), t = 1/(d (1 - r_1)), h = (1 + r_1) t, d the distance of a pole; to the sum z. */
static void bend_modes(num *z, const num *middle, const num *d) {
    HELD(t); HELD(h); HELD(more); HELD(one); HELD(sum);
    for (const mode *m = modes; m < modes_end; m++) for (int turned = 0; turned < 2; turned++) {
        set(&t, m->poles); if (turned) mirrored(&t, &t);
        sub(&t, middle, &t); divide(&t, &ONE, &t); above(&t, &t);
        mul(&h, &t, d); sub(&h, &ONE, &h); if (!positive(&h)) lost = 1;
        divide(&t, &t, &h); sub(&h, &ONE, m->reach); divide(&t, &t, &h); exactly(&t);
        add(&h, &ONE, m->reach); mul(&h, &h, &t); mul(&more, &h, &h); add(&more, &more, &h);
        integer(&sum, 0);
        for (size_t k = 0; k < m->degree; k++) {
            integer(&one, (long)k); add(&one, &one, &h); mul(&one, &one, &one); add(&one, &one, &more);
            exactly(&one); charge(&sum, m->numerator + k, &one);
        }
        mul(&sum, &sum, &t); exactly(&sum); charge(z, about + m->first, &sum); charge(z, within + m->first, &sum);
    }
}
/* How far along an arc a, a + b F and c may be from their chords: the page has the bounds of |f''| s^2/8 and of products of chords. */
static void bend(const known *f, const knot *one, const knot *two) {
    HELD(eighth); HELD(db); HELD(df); HELD(h); HELD(x); HELD(y); num *off = f->off;
    sub(&y, &two->z, &one->z); above(&y, &y);
    if (!at_most(&y, &ONE)) lost = 1;
    mul(&x, &y, &y); integer(&h, 4); sub(&h, &h, &x); add(&h, &h, &h); divide(&eighth, &x, &h); /* s^2 <= y^2/(1 - y^2/4) */
    over(&y, &y, 2); add(&x, &one->z, &two->z); over(&x, &x, 2);
    bends(f, &x, &y); bends(&parametric, &x, &y);
    sub(&h, &rho, &ONE); mul(&h, &h, &h); divide(&h, &rho, &h); mul(&h, &h, &K); /* |d2/dt2 phi(exp(-jt)/rho)| <= rho/(rho - 1)^2 */
    for (size_t i = 0; i < parametric.m; i++) { charge(&h, about + i, parametric.off + i); charge(&h, within + i, parametric.off + i); }
    bend_modes(&h, &x, &y); mul(&h, &h, &eighth);
    for (size_t i = 0; i < f->m; i++) { mul(off + i, off + i, &eighth); exactly(off + i); }
    sub(&db, &two->known[1], &one->known[1]); above(&db, &db); sub(&df, &two->value, &one->value); above(&df, &df);
    mul(&x, &db, &df); over(&x, &x, 4); add(&x, &x, off);
    charge(&db, &one->known[1], &ONE); charge(&x, &db, &h);
    charge(&df, &one->value, &ONE); add(&df, &df, &h); charge(&x, &df, off + 1);
    set(off + 1, &x); exactly(off + 1);
}
/* arcs: |(a + b F)/c| <= bound, or with c = 1; loop: a + b F is not 0, does not turn around 0, |c/(a + b F)| <= bound. Re(u* .) of what is below. */
static int on_arcs(node *claim, node *evidence) {
    HELD(radius); HELD(leak); HELD(limit); HELD(x); HELD(y); HELD(u); HELD(size); node *part[4], *sum[1], *edge, *bound; known f;
    knot *last = (knot *)array(sizeof(knot) / sizeof(num)), *now = (knot *)array(sizeof(knot) / sizeof(num));
    int loop = is(find(claim, "kind"), "loop"), below = loop ? 3 : 2, turns = 0, start = 0;
    FIELDS(claim, part, "kind", "functions", "edges", "bounds"); FIELDS(evidence, sum, "knots");
    if (!zero(&corner)) unreadable("arcs of a class in continuous time", "");
    read_known(&f, part[1]); edge = list(part[2], "edges");
    if (f.m > 3 || f.m < (loop ? 3 : 2) || part[2]->count < 2) unreadable("other functions or fewer edges than there must be", "");
    bound = list_of(part[3], part[2]->count - 1, "a bound of every arc"); *sum = list_of(*sum, part[2]->count, "sums of every knot");
    int proved = !loop || (is(edge, "0") && stable(&f, f.A, 40) && stable(&parametric, parametric.A, 40));
    integer(target, 1); integer(target + 1, 0);
    for (; edge && proved && !lost; edge = edge->next, *sum = (*sum)->next) {
        place(2 * N, 2 * N + 1, edge); integer(now->known + 2, 1);
        set(&now->z, &here); respond(now->known, &f, &here); sums(&now->value, &radius, &leak, *sum);
        mul(now->known + 3, &now->value, now->known + 1); add(now->known + 3, now->known + 3, now->known);
        if (is(edge, "0") || is(edge, "half")) mpz_set_ui(now->known[3].im, 0); /* real there */
        integer(&now->radius, 0); charge(&now->radius, now->known + 1, &radius); exactly(&now->radius);
        mpz_add(now->value.r, now->value.r, radius.re);
        if (edge != part[2]->child) {
            bend(&f, last, now); number(&limit, bound); bound = bound->next;
            add(&u, last->known + below, now->known + below); mpz_set_ui(u.r, 0); above(&size, &u);
            for (int k = 0; k < 2; k++) {
                const knot *end = k ? now : last;
                add(f.off + 3, f.off + 1, &end->radius);
                times(&x, end->known + below, &u, 1); mul(&y, f.off + below, &size); sub(&x, &x, &y); proved &= positive(&x);
                mul(&x, &x, &limit); above(&y, end->known + 5 - below); add(&y, &y, f.off + 5 - below); mul(&y, &y, &size);
                proved &= at_most(&y, &x);
            }
            mpz_mul(T1, last->known[3].re, now->known[3].im); mpz_submul(T1, last->known[3].im, now->known[3].re);
            if ((mpz_sgn(last->known[3].im) < 0) != (mpz_sgn(now->known[3].im) < 0)) turns += mpz_sgn(T1);
        } else start = mpz_sgn(now->known[3].re);
        if (loop && !edge->next) proved &= is(edge, "half") && !turns && mpz_sgn(now->known[3].re) == start;
        knot *swap = last; last = now; now = swap;
    }
    proved &= !lost;
    printf("%sproved: %s on %zu arcs from ", proved ? "" : "not ", loop ? "a + b F has no zero outside of the circle, and |c/(a + b F)| is "
           "at most its bound" : f.m < 3 ? "|a + b F| is at most its bound" : "|(a + b F)/c| is at most its bound", part[3]->count);
    for (edge = part[2]->child; edge->next;) edge = edge->next;
    words(part[2]->child, " to "); words(edge, is(edge, "half") ? " the sample rate" : " rad/s"); puts(", for every consistent system");
    return proved;
}
static int consistent(node *claim, node *evidence) { /* phi = b/a: a and b at nodes, and the coefficients that records see */
    HELD(one); HELD(below); HELD(sum); node *part[2];
    FIELDS(claim, part, "kind"); FIELDS(evidence, part, "reflections", "parameters");
    if (modes != modes_end) unreadable("a system of a class with modes", "");
    size_t count = part[0]->count, all = N + longest; int proved = 1;
    num *a = array(all), *b = array(all), *g = array(count), *p = array(M);
    numbers(g, part[0], count, "reflection coefficients"); numbers(p, part[1], M, "parameters");
    for (size_t s = 0; s < all; s++) integer(a + s, s <= N);
    while (proved && count-- > 0) { /* b, a become g a + zeta b, a + g zeta b */
        above(&one, g + count); proved = less(&one, &ONE);
        for (size_t s = all; s-- > 0;) {
            if (s < N) mul(&one, &zeta[s], b + s);
            else set(&one, s > N ? b + s - 1 : &NONE);
            mul(b + s, g + count, a + s); mul(&below, g + count, &one);
            add(b + s, b + s, &one); add(a + s, a + s, &below);
        }
    }
    for (size_t s = 0; s < all; s++) { /* b becomes phi; the coefficients of a begin with 1 */
        if (s < N) divide(b + s, b + s, a + s);
        for (size_t m = 1; N + m <= s; m++) { mul(&one, a + N + m, b + s - m); sub(b + s, b + s, &one); }
    }
    for (size_t k = 0; proved && k < N + R; k++) {
        set(&one, k < N ? b + k : &NONE);
        for (size_t s = 0; k >= N && s <= record[k - N].t; s++) {
            mul(&below, b + N + s, decay + s); mul(&below, &below, record[k - N].u + record[k - N].t - s);
            add(&one, &one, &below);
        }
        mul(&one, &one, &K);
        for (size_t i = 0; i < M; i++) accumulate(&sum, functions + (k < N ? k : k + N + 2) * M + i, p + i, 0);
        settle(&below, &sum); add(&one, &one, &below);
        sub(&one, samples + k, &one); above(&one, &one); proved &= at_most(&one, bounds + k);
    }
    puts(proved ? "proved: a system of the class keeps every sample within its bound" : "not proved: a system is consistent");
    return proved;
}

/* ---- SHA-256 (FIPS 180-4) of the text of the question. ---- */
static void sha256(const char *text, size_t size, char hex[65]) {
    uint32_t k[64], h[8], w[64], s[8]; mpz_set_ui(T2, 1); /* k and h: the first bits of the roots of primes after the point */
    for (int i = 0; i < 64; i++) {
        mpz_nextprime(T2, T2); mpz_mul_2exp(T1, T2, 96); mpz_root(T1, T1, 3); k[i] = (uint32_t)mpz_get_ui(T1);
        if (i < 8) { mpz_mul_2exp(T1, T2, 64); mpz_sqrt(T1, T1); h[i] = (uint32_t)mpz_get_ui(T1); }
    }
    size_t blocks = (size + 9 + 63) / 64;
    uint32_t *m = room(blocks, 64), *end = m + 16 * blocks;
    mpz_import(T1, size, 1, 1, 0, 0, text); mpz_mul_2exp(T1, T1, 8); mpz_add_ui(T1, T1, 0x80); /* it begins with a brace, so no word is lost */
    mpz_mul_2exp(T1, T1, 8 * (64 * blocks - size - 1)); mpz_add_ui(T1, T1, 8 * size); mpz_export(m, NULL, 1, 4, 0, 0, T1);
#define TURN(x, n) ((x) >> (n) | (x) << (32 - (n)))
    for (; m < end; m += 16) {
        memcpy(s, h, sizeof s); memcpy(w, m, 64);
        for (int i = 0; i < 64; i++) {
            if (i > 15) w[i] = w[i - 16] + (TURN(w[i - 15], 7) ^ TURN(w[i - 15], 18) ^ w[i - 15] >> 3) + w[i - 7] +
                               (TURN(w[i - 2], 17) ^ TURN(w[i - 2], 19) ^ w[i - 2] >> 10);
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
static size_t read_record(node *one, size_t first, const num *level) { /* u, samples [t, y, bound], and responses of the functions */
    HELD(response); node *part[2], *row;
    FIELDS(one, part, "input", "samples");
    const known *f = &parametric;
    size_t S = f->n, count = part[0]->count;
    num *u = array(count), *state = array(S), *next = array(S), *out = array(M * (count + 1));
    numbers(u, part[0], count, "inputs");
    for (size_t t = 0; t < count; t++) {
        product(out + t * M, f->C, state, M, S, 1); product(next, f->A, state, S, S, 1);
        for (size_t i = 0; i < M; i++) { mul(&response, f->D + i, u + t); add(out + t * M + i, out + t * M + i, &response); }
        for (size_t a = 0; a < S; a++) { mul(&response, f->B + a, u + t); add(state + a, next + a, &response); }
    }
    for (row = list(part[1], "samples"); row; row = row->next, first++) {
        node *child = list_of(row, 3, "a sample [t, y, bound]");
        size_t t = index_below(child, count);
        record[first].u = u; record[first].t = t;
        if (t >= longest) longest = t + 1;
        number(samples + N + first, child->next);
        above_zero(bounds + N + first, child->next->next, "bound of a sample"); mul(bounds + N + first, bounds + N + first, level);
        for (size_t i = 0; i < M; i++) set(functions + (2 * N + 2 + first) * M + i, out + t * M + i);
    }
    return first;
}
static void read_question(node *part[7]) {
    HELD(level); node *unit[3], *two[2], *of[4], *row = list(part[4], "data"), *one; size_t first = 0;
    FIELDS(part[2], unit, "frequency", "time", "response");
    if (!is(unit[0], "rad/s") || !is(unit[1], "s") || unit[2]->kind != 's') unreadable("the units must be rad/s, s, and a string", "");
    above_zero(&level, part[3], "level"); N = part[4]->count;
    for (one = list(part[5], "records"); one; one = one->next) {
        FIELDS(one, two, "input", "samples");
        if (two[0]->count > powers) powers = two[0]->count;
        R += two[1]->count;
    }
    if (!(N + R) || N > SAMPLES || R > SAMPLES || powers > TERMS) unreadable("no data, or more of it than version 1 allows", "");
    nodes = 2 * N + 2;
    if (part[0]->count == 4) FIELDS(part[0], of, "gain_bound", "decay_rate", "functions", "modes");
    else FIELDS(part[0], of, "gain_bound", "decay_rate", "functions");
    above_zero(&K, of[0], "gain_bound");
    if (is(part[1], "continuous")) { /* |phi| <= 1 where Re s > -alpha: [alpha, corner] */
        one = list_of(of[1], 2, "a decay rate [alpha, corner]");
        above_zero(&rho, one, "decay rate"); above_zero(&corner, one->next, "corner"); integer(&sample_time, 1);
        divide(&kappa, &rho, &corner); add(&rho, &ONE, &kappa);
    } else { above_zero(&sample_time, part[1], "sample_time"); above_zero(&rho, of[1], "decay_rate"); }
    if (!less(&ONE, &rho)) unreadable("a decay rate that is not above 1", "");
    read_known(&parametric, of[2]); M = parametric.m;
    if (part[0]->count == 4) read_modes(of[3]);
    if (R && (modes != modes_end || !zero(&corner))) unreadable("records of a class with modes, or in continuous time", "");
    about = array(M); within = array(M); target = array(2); wanted = array(M);
    samples = array(N + R); bounds = array(N + R); zeta = array(nodes); functions = array((nodes + R) * M); decay = array(powers);
    record = room(R, sizeof *record); if (N <= CACHED) { cauchy = array(nodes * nodes); ready = room(nodes * nodes, 1); }
    for (size_t s = 0; s < powers; s++) { if (s) divide(decay + s, decay + s - 1, &rho); else integer(decay, 1); }
    for (size_t k = 0; k < N; k++, row = row->next) {
        node *child = list_of(row, 4, "a line [omega, re, im, bound]");
        place(k, N + k, child); complex(samples + k, child->next);
        above_zero(bounds + k, child->next->next->next, "bound of a sample"); mul(bounds + k, bounds + k, &level);
    }
    for (one = part[5]->child; one; one = one->next) first = read_record(one, first, &level);
}
int main(int count, char **words_of) {
    node *part[5], *asked[7], *proof[3], *claim, *evidence;
    FILE *file = count == 2 ? fopen(words_of[1], "rb") : NULL;
    char hex[65];
    mpz_inits(T1, T2, T3, NULL);
    if (!file) unreadable(count == 2 ? "cannot open" : "usage: robustid-proof FILE", count == 2 ? words_of[1] : "");
    long size = fseek(file, 0, SEEK_END) ? -1 : ftell(file);
    if (size < 0 || size > LARGEST || fseek(file, 0, SEEK_SET)) unreadable("no file of at most 256 MiB", words_of[1]);
    char *text = room((size_t)size + 1, 1);
    at = text; size = (long)fread(text, 1, (size_t)size, file); fclose(file);
    node *whole = value(0); blank();
    if (at != text + size) unreadable("something follows after the proof", "");
    FIELDS(whole, part, "format", "version", "digest", "question", "evidence");
    if (!is(part[0], "robustid-proof") || index_below(part[1], 1000) != 1) unreadable("this is not version 1 of robustid-proof", "");
    FIELDS(part[3], asked, "class", "sample_time", "units", "level", "data", "records", "statements");
    FIELDS(part[4], proof, "powers", "parameters", "statements");
    sha256(part[3]->start, (size_t)(part[3]->end - part[3]->start), hex);
    if (!is(part[2], hex)) { printf("not proved: the digest is not that of the question, %s\n", hex); return 1; }
    claim = list(asked[6], "statements");
    evidence = list_of(proof[2], asked[6]->count, "evidence of every statement");
    if (!claim) unreadable("there are no statements", "");
    powers = index_below(proof[0], TERMS + 1);
    for (node *one = evidence; one; one = one->next) { /* two bits for every step of the recursion of a system */
        node *gains = one->kind == 'o' ? find(one, "reflections") : NULL;
        if (gains && gains->count > TERMS) unreadable("more reflection coefficients than version 1 allows", "");
        if (gains && P < 320 + 2 * gains->count) P = 320 + 2 * gains->count;
    }
    num *made[] = {&ONE, &NONE, &K, &rho, &sample_time, &here, &corner, &kappa};
    for (size_t k = 0; k < sizeof made / sizeof *made; k++) mpz_inits(made[k]->re, made[k]->im, made[k]->r, NULL);
    integer(&ONE, 1);
    read_question(asked);
    int proved = 1;
    printf("question %s: %zu lines, %zu samples of records, %zu parametric functions, bounds times ", hex, N, R, M); words(asked[3], "\n");
    if (!parameters_proved(proof[1]) || lost) { puts("not proved: what the evidence says of the parameters, on which all statements stand"); return 1; }
    for (; claim; claim = claim->next, evidence = evidence->next) {
        node *kind = claim->kind == 'o' ? find(claim, "kind") : NULL;
        if (!kind) unreadable("a statement without a kind", "");
        int sum = is(kind, "disc") || is(kind, "support") || is(kind, "inconsistent"), arcs = is(kind, "arcs") || is(kind, "loop");
        if (!sum && !arcs && !is(kind, "consistent")) unreadable("a kind of statement that version 1 does not know", "");
        lost = 0;
        proved &= (sum ? by_sums : arcs ? on_arcs : consistent)(claim, evidence) && !lost;
    }
    puts(proved ? "all statements are proved" : "not all statements are proved");
    return proved ? 0 : 1;
}
