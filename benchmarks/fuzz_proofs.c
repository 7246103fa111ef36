/* fuzz_proofs COUNT SEED FILE...: gives the checker of proofs COUNT broken copies of the files, many in one process.
 *
 * The checker is included as it is; its exit becomes a jump. A child process takes a batch of inputs (its end frees their memory), and the
 * last one of each batch is read once more in a fresh process, which must say the same. To the standard output go the accepted files, "a SIZE"
 * and the text, and at the end "e", the numbers of files that are proved, not proved and not readable, of those read twice, the longest
 * processor time in microseconds and the largest memory of a batch in KiB. A crash ends it with status 3; the file is kept.
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <gmp.h>
#include <setjmp.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static jmp_buf back;
#define exit(status) longjmp(back, 1 + (status))
#define main checked
#include "../proof/robustid_proof.c"
#undef main
#undef exit

enum { ROOM = 1 << 20, SPANS = 20000, BATCH = 1000, MEMORY = 400 << 10, SECONDS = 60, NESTED = 64 };
typedef struct { char *text; size_t size; } file;
typedef struct { size_t from, to; } span;
enum { NUMBERS, WORDS, INDICES, PARTS, SORTS }; /* strings with numbers, other strings, bare integers, lists and objects */
static struct { long tried, counts[3], twice; int status; clock_t slowest; long memory; size_t size; char text[ROOM + 1]; } *shared;
static file *seeds;
static size_t many_seeds, many[SORTS];
static span found[SORTS][SPANS];
static uint64_t drawn;

static size_t below(size_t limit) { /* splitmix64 */
    uint64_t z = drawn += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u; z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return limit ? (size_t)((z ^ z >> 31) % limit) : 0;
}
static void mark(int sort, size_t from, size_t to) { if (many[sort] < SPANS) found[sort][many[sort]++] = (span){from, to}; }
static void scan(const char *text, size_t size) {
    size_t open[NESTED], depth = 0;
    memset(many, 0, sizeof many);
    for (size_t k = 0; k < size; k++) {
        size_t from = k;
        if (text[k] == '"') {
            for (k++; k < size && text[k] != '"';) k++;
            const char *s = text + from + 1 + (from + 1 < size && text[from + 1] == '-');
            if (k - from != 65) mark(s < text + k && *s >= '0' && *s <= '9' ? NUMBERS : WORDS, from + 1, k);
        } else if (text[k] >= '0' && text[k] <= '9') {
            while (k + 1 < size && text[k + 1] >= '0' && text[k + 1] <= '9') k++;
            mark(INDICES, from, k + 1);
        } else if (text[k] == '[' || text[k] == '{') { if (depth < NESTED) open[depth++] = k; }
        else if ((text[k] == ']' || text[k] == '}') && depth) mark(PARTS, open[--depth], k + 1);
    }
}
static void put(size_t from, size_t to, const char *text, size_t size) {
    if (to > shared->size) to = shared->size; /* a string that does not end */
    if (from > to || shared->size - (to - from) + size > ROOM) return;
    memmove(shared->text + from + size, shared->text + to, shared->size - to);
    memcpy(shared->text + from, text, size);
    shared->size += size - (to - from);
}
static void put_words(span one, const char *text) { put(one.from, one.to, text, strlen(text)); }

/* The number times 1 +- 10^-places, exactly: its digits times 10^places +- 1, and the exponent less by as much (of dyadic ones in bits). */
static void enlarge(span one, int places) {
    char digits[500], text[600];
    size_t count = 0, s = one.from;
    long shift = 0, exponent = 0;
    for (int point = 0; s < one.to && count < 480 && (strchr("-.", shared->text[s]) || (shared->text[s] >= '0' && shared->text[s] <= '9')); s++) {
        if (shared->text[s] == '.') { point = 1; continue; }
        digits[count++] = shared->text[s]; shift += point;
    }
    digits[count] = 0;
    if (s < one.to) exponent = strtol(shared->text + s + 1, NULL, 10); /* what follows the string is a quotation mark */
    int dyadic = s < one.to && shared->text[s] == 'p';
    mpz_t value, by;
    mpz_inits(value, by, NULL);
    mpz_ui_pow_ui(by, dyadic ? 2 : 10, (unsigned long)(dyadic ? 10 * places / 3 : places));
    if (below(2)) mpz_add_ui(by, by, 1); else mpz_sub_ui(by, by, 1);
    if (!mpz_set_str(value, digits, 10)) {
        mpz_mul(value, value, by);
        gmp_snprintf(text, sizeof text, "%Zd%c%ld", value, dyadic ? 'p' : 'e', exponent - shift - (dyadic ? 10 * places / 3 : places));
        put_words(one, text);
    }
    mpz_clears(value, by, NULL);
}
static void put_part(span one, const file *from, span two) {
    static char taken[ROOM];
    memcpy(taken, from->text + two.from, two.to - two.from);
    put(one.from, one.to, taken, two.to - two.from);
}
static span any(int sort) { return found[sort][below(many[sort])]; }
static span claim(void) { /* the first number after a word of claims */
    static const char *words_of[] = {"\"radius\"", "\"value\"", "\"bounds\"", "\"centre\"", "\"level\""};
    const char *word = words_of[below(5)], *said = memmem(shared->text, shared->size, word, strlen(word));
    for (size_t k = 0; said && k < many[NUMBERS]; k++) if (shared->text + found[NUMBERS][k].from > said) return found[NUMBERS][k];
    return any(NUMBERS);
}
static void change_number(const file *same_file) {
    static const char *strange[] = {"NaN", "Infinity", "1e400", "1e999", "9p9999", "1p-4000", "", "-", "0x10", "1e-400", "0", "-0", "1p+4000",
        "1e-", "1p", "1.5p3", "1..2", "1.", "-1e+5", "4", "0.99999999", "1", "1000000000000000000000000000000", "half"};
    span one = any(NUMBERS);
    char *s = shared->text + one.from, digit = (char)('0' + below(10));
    size_t size = one.to - one.from, place = below(size < 6 ? size : 6);
    switch (below(16)) {
    case 0: case 1: if (*s == '-') put(one.from, one.from + 1, "", 0); else put(one.from, one.from, "-", 1); break;
    case 2: put_words(one, strange[below(sizeof strange / sizeof *strange)]); break;
    case 3: case 4: case 5: put_part(one, same_file, any(NUMBERS)); break;
    case 6: put(one.from + place, one.from + place, &digit, 1); break;
    case 7: enlarge(one, 1 + (int)below(4)); break;
    case 8: case 9: case 10: case 11: enlarge(claim(), 4 + (int)below(4)); break;
    default: if (place < size && s[place] >= '0' && s[place] <= '9') s[place] = digit; /* among the first ones */
    }
}
static void change_part(const file *same_file) {
    static char copies[ROOM];
    span one = any(PARTS);
    size_t size = one.to - one.from, times = below(8) ? 1 : below(200);
    const file *other = &seeds[below(many_seeds)];
    switch (below(5)) {
    case 0: put(one.from, one.to + (one.to < shared->size && shared->text[one.to] == ','), "", 0); break;
    case 1: case 2: put_part(one, same_file, any(PARTS)); break;
    case 3: scan(other->text, other->size); put_part(one, other, any(PARTS)); break;
    default: /* once more, or many times */
        for (size_t k = 0; k < times && (k + 1) * (size + 1) < ROOM; k++) {
            memcpy(copies + k * (size + 1), shared->text + one.from, size); copies[k * (size + 1) + size] = ',';
            if (k + 1 == times) put(one.from, one.from, copies, times * (size + 1));
        }
    }
}
static void change_bytes(void) {
    static char text[5000];
    static const char odd[] = "[{\"9]}:,\\\0\xff\n-e ";
    size_t place = below(shared->size), count = 1 + below(below(8) ? 60 : sizeof text - 1);
    char c = (char)below(256);
    const file *other = &seeds[below(many_seeds)];
    switch (below(7)) {
    case 0: shared->size = place; break;
    case 1: put(place, place + 1, &c, 1); break;
    case 2: put(place, place + 1, "", 0); break;
    case 3: put(place, place, &c, 1); break;
    case 4: put(place, place, "{\"a\": [[", 8); break;
    case 5: if (place < other->size) put(place, shared->size, other->text + place, other->size - place); break;
    default: memset(text, odd[below(sizeof odd - 1)], count); put(place, place + below(2) * below(20), text, count);
    }
}
static void mutate(void) {
    static const char *known_words[] = {"disc", "support", "inconsistent", "consistent", "arcs", "loop", "kind", "omega", "half", "rad/s", "Hz", "s",
        "ms", "centre", "radius", "value", "direction", "bounds", "edges", "functions", "knots", "base", "factors", "multipliers", "f", "g", "A", "B",
        "C", "D", "reflections", "parameters", "combinations", "powers", "level", "records", "data", "input", "samples", "question", "digest"};
    const file here_now = {shared->text, shared->size};
    char text[20];
    size_t kind = below(30);
    scan(shared->text, shared->size);
    if (kind < 16 && many[NUMBERS]) change_number(&here_now);
    else if (kind < 20 && many[INDICES]) {
        snprintf(text, sizeof text, "%zu", below(below(2) ? 12 : below(50) ? 60 : 5000));
        put_words(any(INDICES), text);
    } else if (kind < 21 && many[WORDS]) put_words(any(WORDS), known_words[below(sizeof known_words / sizeof *known_words)]);
    else if (kind < 27 && many[PARTS]) change_part(&here_now);
    else if (shared->size) change_bytes();
}
static void seal(void) { /* the digest of the question that now stands in the file, where one can be found */
    char hex[65], *end = shared->text + shared->size, *from = memmem(shared->text, shared->size, "\"question\"", 10);
    char *digest = memmem(shared->text, shared->size, "\"digest\"", 8);
    if (!from || !digest || !(from = memchr(from, '{', (size_t)(end - from)))) return;
    char *to = from;
    long depth = 0;
    for (int quoted = 0; to < end; to++) {
        if (*to == '"') quoted = !quoted;
        else if (!quoted && (*to == '{' || *to == '[')) depth++;
        else if (!quoted && (*to == '}' || *to == ']') && !--depth) break;
    }
    if (to == end) return;
    sha256((unsigned char *)from, (size_t)(to + 1 - from), hex);
    if (!(from = memchr(digest + 8, '"', (size_t)(end - digest - 8))) || !(to = memchr(from + 1, '"', (size_t)(end - from - 1)))) return;
    put((size_t)(from + 1 - shared->text), (size_t)(to - shared->text), hex, 64);
}
static void make(long k, uint64_t seed) { /* the input k: it depends on nothing else */
    static const int times[] = {1, 1, 1, 2, 2, 5};
    drawn = seed * 1000003u + (uint64_t)k;
    const file *one = &seeds[below(many_seeds)];
    do {
        memcpy(shared->text, one->text, shared->size = one->size);
        for (int left = times[below(6)]; left; left--) mutate();
        if (below(20)) seal();
    } while (shared->size == one->size && !memcmp(shared->text, one->text, one->size));
}

static int run(const char *name) { /* the exit status of the checker, of the text in a file */
    static char *own[3] = {"robustid-proof"};
    int folder = open(name, O_RDWR | O_CREAT | O_TRUNC, 0600);
    if (folder < 0 || write(folder, shared->text, shared->size) != (ssize_t)shared->size) _exit(97);
    close(folder);
    own[1] = (char *)name;
    P = 320; lost = 0; N = M = R = nodes = powers = longest = 0; cauchy = NULL; ready = NULL; modes = modes_end = NULL;
    int jumped = setjmp(back);
    return jumped ? jumped - 1 : checked(2, own);
}
static void batch(long count, uint64_t seed, const char *name, int answers) {
    struct rusage use;
    struct itimerval limit = {{0, 0}, {SECONDS, 0}};
    for (long k = 0; k < BATCH && shared->tried < count; k++) {
        make(shared->tried, seed);
        setitimer(ITIMER_PROF, &limit, NULL); /* ends the process */
        clock_t began = clock();
        int status = shared->status = run(name);
        if (clock() - began > shared->slowest) shared->slowest = clock() - began;
        if (status < 0 || status > 2) _exit(96);
        shared->counts[status]++; shared->tried++;
        if (!status) {
            dprintf(answers, "a %zu\n", shared->size);
            for (size_t sent = 0; sent < shared->size;) {
                ssize_t some = write(answers, shared->text + sent, shared->size - sent);
                if (some <= 0) _exit(95);
                sent += (size_t)some;
            }
        }
        getrusage(RUSAGE_SELF, &use);
        if (use.ru_maxrss > shared->memory) shared->memory = use.ru_maxrss;
        if (use.ru_maxrss > MEMORY) break;
    }
    _exit(0);
}
static void read_seed(file *one, const char *name) {
    FILE *from = fopen(name, "rb");
    if (!from) abort();
    one->text = malloc(ROOM); one->size = fread(one->text, 1, ROOM / 4, from);
    fclose(from);
}
int main(int count, char **names) {
    if (count < 4) return 2;
    const long all = atol(names[1]);
    char name[500];
    int answers = dup(1), status;
    snprintf(name, sizeof name, "%s.json", names[0]); /* beside the program */
    if (answers < 0 || !freopen("/dev/null", "w", stdout)) return 2;
    shared = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED) return 2;
    many_seeds = (size_t)count - 3; seeds = calloc(many_seeds, sizeof *seeds);
    for (size_t k = 0; k < many_seeds; k++) read_seed(&seeds[k], names[3 + k]);
    while (shared->tried < all) {
        for (int again = 0; again < 2; again++) {
            pid_t child = fork();
            if (!child && !again) batch(all, strtoull(names[2], NULL, 10), name, answers);
            if (!child) _exit(run(name) == shared->status ? 0 : 94);
            if (child < 0 || waitpid(child, &status, 0) < 0) return 2;
            if (status) {
                FILE *kept = fopen("fuzz_proofs_found.json", "wb");
                if (kept) { fwrite(shared->text, 1, shared->size, kept); fclose(kept); }
                fprintf(stderr, "input %ld ends with status %#x, and is kept in fuzz_proofs_found.json\n", shared->tried, (unsigned)status);
                return 3;
            }
        }
        shared->twice++;
    }
    dprintf(answers, "e %ld %ld %ld %ld %ld %ld\n", shared->counts[0], shared->counts[1], shared->counts[2], shared->twice,
            (long)shared->slowest * 1000000 / CLOCKS_PER_SEC, shared->memory);
    return 0;
}
