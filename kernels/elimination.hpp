// Elimination within one matrix, in place: vip_factors/solve/elimination.py and band.py, by SciPy's own BLAS and LAPACK.
//
// Matrices are stored by rows, of which only the triangle above the diagonal counts: to BLAS, which stores by columns,
// that is the triangle below the diagonal.
#pragma once
#include <algorithm>
#include <cstdint>
#include <vector>

namespace vip {

struct Blas {
    void (*dpotrf)(const char*, int*, double*, int*, int*);
    void (*dtrsm)(const char*, const char*, const char*, const char*, int*, int*, double*, double*, int*, double*, int*);
    void (*dsyrk)(const char*, const char*, int*, int*, double*, double*, int*, double*, double*, int*);
    void (*dtrsv)(const char*, const char*, const char*, int*, double*, int*, double*, int*);
    void (*dgemv)(const char*, int*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
    void (*dgemm)(const char*, const char*, int*, int*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
};

constexpr int REACH = 2;  // frames after its own that a factor sees
inline double ONE = 1.0, MINUS_ONE = -1.0;
inline int NEXT = 1;
constexpr int SMALL = 24;  // variables that are eliminated at once

// R and S of the first w of n rows of which each begins `row` behind the last, in their place: in halves, for products of
// matrices are quicker than the substitutions that they spare. False if these variables are not determined.
inline bool factorise(const Blas& blas, double* M, int row, int n, int w) {
    if (w <= SMALL) {
        int rest = n - w, failed = 0;
        blas.dpotrf("L", &w, M, &row, &failed);
        if (!failed && rest > 0) blas.dtrsm("R", "L", "T", "N", &rest, &w, &ONE, M, &row, M + w, &row);
        return !failed;
    }
    int half = (w + 15) / 16 * 8, other = w - half, rest = n - w;
    if (!factorise(blas, M, row, n, half)) return false;
    double* then = M + (row + 1) * static_cast<int64_t>(half);
    blas.dsyrk("L", "N", &other, &half, &MINUS_ONE, M + half, &row, &ONE, then, &row);
    if (rest > 0) blas.dgemm("N", "T", &rest, &other, &half, &MINUS_ONE, M + w, &row, M + half, &row, &ONE, then + other, &row);
    return factorise(blas, then, row, n - half, other);
}

// The first w variables of ½ xᵀ M x − vᵀ x out of n, in rows of which each begins `row` behind the last: then M holds R
// and S in its first rows, and what is said of the others in `rest`, with rows of its own; so does v. False if they are
// not determined.
inline bool eliminate(const Blas& blas, double* M, double* v, int row, int n, int w, double* rest, int rest_row) {
    int others = n - w;
    if (w == 0) return true;
    if (!factorise(blas, M, row, n, w)) return false;
    blas.dtrsv("L", "N", "N", &w, M, &row, v, &NEXT);
    if (others == 0) return true;
    blas.dsyrk("L", "N", &others, &w, &MINUS_ONE, M + w, &row, &ONE, rest, &rest_row);
    blas.dgemv("N", &others, &w, &MINUS_ONE, M + w, &row, v, &NEXT, &ONE, v + w, &NEXT);
    return true;
}

// x of R x + S y = x as it was, of w rows of M.
inline void substitute(const Blas& blas, double* M, int row, int n, int w, double* y, double* x) {
    int rest = n - w;
    if (w == 0) return;
    if (rest > 0) blas.dgemv("T", &rest, &w, &MINUS_ONE, M + w, &row, y, &NEXT, &ONE, x, &NEXT);
    blas.dtrsv("L", "T", "N", &w, M, &row, x, &NEXT);
}

// A stretch of frames of w columns, each of which sees all columns of the next and `far` ones of that after it, unless
// frames are independent, and shared ones. Of a stretch there are rows (frames + 2, w, m), whose columns are those of the
// frame, of the next two where these are seen, and the `said` shared ones; with itself the upper triangle counts. The first
// `own` columns of frames are eliminated. Others are met in one frame only: they are the last of the s shared columns,
// frame after frame.
struct Stretch {
    const double *rows, *gradient, *shared, *shared_gradient;
    const int64_t* far;
    int64_t frames, fars, w, said;
    int own, s;
    bool tied;
    int64_t ahead() const { return tied ? own + fars : 0; }
    int64_t rest() const { return ahead() + s; }
    int64_t width() const { return (tied ? 3 : 1) * w + said; }
    int64_t met(int64_t t) const { return own + rest() - (frames - t) * (w - own); }  // columns of and before a frame's rows
    int seen(int64_t t) const { return static_cast<int>(met(t + 1)); }  // those behind are of frames to come
};

inline void add(const double* from, int64_t count, double* to) {
    for (int64_t c = 0; c < count; c++) to[c] += from[c];
}

// What is known of the two frames after, of which the second has far columns only, and of shared ones: as the first frame's
// own rows of n columns, and for the frames after it, in place. There are zeros or nothing behind `seen` columns of a row.
inline void move_on(const Stretch& of, int64_t seen, double* M, double* v, double* own, double* own_vector) {
    const int64_t w = of.own, ahead = of.ahead(), rest = of.rest(), n = w + rest, end = seen - w;
    for (int64_t r = 0; r < w; r++) std::fill(own + r * n + r, own + r * n + seen, 0.0);
    std::fill(own_vector, own_vector + w, 0.0);
    if (!of.tied) return;
    for (int64_t r = 0; r < w; r++) {
        double *to = own + r * n, *from = M + r * rest;
        std::copy(from + r, from + w, to + r);
        for (int64_t k = 0; k < of.fars; k++) to[w + of.far[k]] = from[w + k];
        std::copy(from + ahead, from + end, to + w + ahead);
        std::fill(from + r, from + end, 0.0);
        own_vector[r] = v[r], v[r] = 0.0;
    }
    for (int64_t k = 0; k < of.fars; k++) {
        double *to = M + of.far[k] * rest, *from = M + (w + k) * rest;
        for (int64_t l = k; l < of.fars; l++) to[of.far[l]] = from[w + l];
        std::copy(from + ahead, from + end, to + ahead);
        std::fill(from + w + k, from + end, 0.0);
        v[of.far[k]] = v[w + k], v[w + k] = 0.0;
    }
}

// M (rest, rest) and v hold what is known before the stretch, and in the end what is behind it. rows (frames, own, n) and d
// (frames, own) hold R, S and d of each frame. False if a frame is not determined.
inline bool eliminate_stretch(const Blas& blas, const Stretch& of, const double* damping, double* M, double* v, double* rows, double* d) {
    const int64_t w = of.own, ahead = of.ahead(), rest = of.rest(), n = w + rest, m = of.width(), said = of.said;
    std::vector<double> vector(n);
    for (int64_t t = 0; t < of.frames; t++, rows += w * n, d += w) {
        move_on(of, of.seen(t), M, v, rows, vector.data());
        for (int64_t r = 0; r < w; r++) {
            const double* from = of.rows + (t * of.w + r) * m;
            double* to = rows + r * n;
            add(from + r, w - r, to + r);
            if (of.tied) add(from + of.w, w, to + w);
            for (int64_t k = 0; of.tied && k < of.fars; k++) to[2 * w + k] += from[2 * of.w + of.far[k]];
            add(from + m - said, said, to + w + ahead);
            add(from + w, of.w - w, to + of.met(t));
            to[r] += damping[r], vector[r] -= of.gradient[t * of.w + r];
        }
        std::copy(v, v + rest, vector.begin() + w);
        if (!eliminate(blas, rows, vector.data(), static_cast<int>(n), of.seen(t), of.own, M, static_cast<int>(rest))) return false;
        std::copy(vector.begin(), vector.begin() + w, d);
        std::copy(vector.begin() + w, vector.end(), v);
    }
    const double* next = of.rows + of.frames * of.w * m;  // what the stretch's factors say of the two frames behind it
    for (int64_t r = 0; of.tied && r < w; r++, next += m) {
        add(next + r, w - r, M + r * rest + r);
        for (int64_t k = 0; k < of.fars; k++) M[r * rest + w + k] += next[of.w + of.far[k]];
        add(next + m - said, said, M + r * rest + ahead);
        v[r] -= of.gradient[of.frames * of.w + r];
    }
    next = of.rows + (of.frames + 1) * of.w * m;
    for (int64_t k = 0; of.tied && k < of.fars; k++) {
        const double* after = next + of.far[k] * m;
        double* to = M + (w + k) * rest;
        for (int64_t l = k; l < of.fars; l++) to[w + l] += after[of.far[l]];
        add(after + m - said, said, to + ahead);
        v[w + k] -= of.gradient[(of.frames + 1) * of.w + of.far[k]];
    }
    for (int64_t r = 0; r < said; r++) {
        add(of.shared + r * said + r, said - r, M + (ahead + r) * rest + ahead + r);
        v[ahead + r] -= of.shared_gradient[r];
    }
    return true;
}

// The steps (frames, own), in the place of d, of those of the two frames behind the stretch (2, own) and of shared columns.
inline void substitute_stretch(const Blas& blas, const Stretch& of, double* rows, const double* behind, const double* shared, double* steps) {
    const int64_t w = of.own, ahead = of.ahead(), n = w + of.rest();
    std::vector<double> later(of.rest());
    std::copy(shared, shared + of.s, later.begin() + ahead);
    for (int64_t t = of.frames - 1; t >= 0; t--) {
        const double* next = t + 1 < of.frames ? steps + (t + 1) * w : behind + (t + 1 - of.frames) * w;
        const double* after = t + 2 < of.frames ? steps + (t + 2) * w : behind + (t + 2 - of.frames) * w;
        if (of.tied) std::copy(next, next + w, later.begin());
        for (int64_t k = 0; of.tied && k < of.fars; k++) later[w + k] = after[of.far[k]];
        substitute(blas, rows + t * w * n, static_cast<int>(n), of.seen(t), of.own, later.data(), steps + t * w);
    }
}

// Adds what lies on and above the diagonal of k columns to those at ascending places of another matrix.
inline void add_upper(const double* from, int64_t row, int64_t k, const int64_t* places, double* M, int64_t n) {
    for (int64_t first = 0, end; first < k; first = end) {  // in runs of columns that stay beside each other
        for (end = first + 1; end < k && places[end] == places[end - 1] + 1; end++) {}
        for (int64_t i = 0; i < end; i++) {
            const int64_t j = std::max(i, first);
            const double* source = from + i * row + j;
            double* into = M + places[i] * n + places[j];
            for (int64_t c = 0; c < end - j; c++) into[c] += source[c];
        }
    }
}

}  // namespace vip
