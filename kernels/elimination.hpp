// Elimination of variables in place (vip_factors/solve/elimination.py and band.py), with the BLAS and LAPACK of SciPy.
//
// Matrices are row-major and only their upper triangle is used. BLAS is column-major: there it is the lower triangle.
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

constexpr int REACH = 2;  // later frames that a factor connects its first frame with
inline double ONE = 1.0, MINUS_ONE = -1.0;
inline int NEXT = 1;
constexpr int SMALL = 24;  // variables below which LAPACK factorises without recursion

// Computes R and S of the first w of n variables in place; `row` is the stride of the rows. Recursion by halves replaces
// triangular solves by matrix products, which are faster. Returns false if the variables are not determined.
inline bool factorise(const Blas& blas, double* M, int row, int n, int w) {
    if (w <= SMALL) {
        int rest = n - w, failed = 0;
        blas.dpotrf("L", &w, M, &row, &failed);
        if (!failed && rest > 0) blas.dtrsm("R", "L", "T", "N", &rest, &w, &ONE, M, &row, M + w, &row);
        return !failed;
    }
    int half = (w + 15) / 16 * 8, second_half = w - half, rest = n - w;
    if (!factorise(blas, M, row, n, half)) return false;
    double* corner = M + (row + 1) * static_cast<int64_t>(half);
    blas.dsyrk("L", "N", &second_half, &half, &MINUS_ONE, M + half, &row, &ONE, corner, &row);
    if (rest > 0) blas.dgemm("N", "T", &rest, &second_half, &half, &MINUS_ONE, M + w, &row, M + half, &row, &ONE, corner + second_half, &row);
    return factorise(blas, corner, row, n - half, second_half);
}

// Eliminates the first w of n variables of ½ xᵀ M x − vᵀ x; `row` and `rest_row` are strides. The first rows of M become
// R and S, the first w entries of v become d. The Schur complement is added to `rest`, its vector to the end of v.
// Returns false if the variables are not determined.
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

// Back-substitutes in place: x becomes the solution of R x + S y = d, where x holds d. R and S are the first w rows of M.
inline void substitute(const Blas& blas, double* M, int row, int n, int w, double* y, double* x) {
    int rest = n - w;
    if (w == 0) return;
    if (rest > 0) blas.dgemv("T", &rest, &w, &MINUS_ONE, M + w, &row, y, &NEXT, &ONE, x, &NEXT);
    blas.dtrsv("L", "T", "N", &w, M, &row, x, &NEXT);
}

// A stretch of frames with w columns each. If frames are tied, a frame is connected with all columns of the next frame and
// with the `far` columns of the one after it; in any case it is connected with shared columns. The rows (frames + 2, w, m)
// hold the columns of the frame, of the next two frames if tied, and of `shared_width` shared variables. The first
// `eliminated` columns of a frame are eliminated. Its extra columns belong to no other frame: they are the last of the s
// border columns, frame after frame.
struct Stretch {
    const double *rows, *gradient, *shared, *shared_gradient;
    const int64_t* far;
    int64_t frames, fars, w, shared_width;
    int eliminated, s;
    bool tied;
    int64_t ahead() const { return tied ? eliminated + fars : 0; }
    int64_t rest() const { return ahead() + s; }
    int64_t width() const { return (tied ? 3 : 1) * w + shared_width; }
    int64_t extra_column(int64_t t) const { return eliminated + rest() - (frames - t) * (w - eliminated); }  // first extra column of frame t
    int used_columns(int64_t t) const { return static_cast<int>(extra_column(t + 1)); }  // later ones belong to later frames
};

inline void add(const double* from, int64_t count, double* to) {
    for (int64_t c = 0; c < count; c++) to[c] += from[c];
}

// Shifts the marginal M on the next frame, the far columns of the one after it, and the border by a frame, in place. The
// rows of the next frame are moved to `frame_rows` (w, n); they have zeros after `used` columns.
inline void shift_frame(const Stretch& stretch, int64_t used, double* M, double* v, double* frame_rows, double* frame_vector) {
    const int64_t w = stretch.eliminated, ahead = stretch.ahead(), rest = stretch.rest(), n = w + rest, end = used - w;
    for (int64_t r = 0; r < w; r++) std::fill(frame_rows + r * n + r, frame_rows + (r + 1) * n, 0.0);
    std::fill(frame_vector, frame_vector + w, 0.0);
    if (!stretch.tied) return;
    for (int64_t r = 0; r < w; r++) {
        double *to = frame_rows + r * n, *from = M + r * rest;
        std::copy(from + r, from + w, to + r);
        for (int64_t k = 0; k < stretch.fars; k++) to[w + stretch.far[k]] = from[w + k];
        std::copy(from + ahead, from + end, to + w + ahead);
        std::fill(from + r, from + end, 0.0);
        frame_vector[r] = v[r], v[r] = 0.0;
    }
    for (int64_t k = 0; k < stretch.fars; k++) {
        double *to = M + stretch.far[k] * rest, *from = M + (w + k) * rest;
        for (int64_t l = k; l < stretch.fars; l++) to[stretch.far[l]] = from[w + l];
        std::copy(from + ahead, from + end, to + ahead);
        std::fill(from + w + k, from + end, 0.0);
        v[stretch.far[k]] = v[w + k], v[w + k] = 0.0;
    }
}

// Eliminates the frames of a stretch. M (rest, rest) and v hold the marginal before the stretch, then the one after it.
// `rows` (frames, eliminated, n) and d (frames, eliminated) receive R, S and d of each frame. Returns false if a frame is
// not determined.
inline bool eliminate_stretch(const Blas& blas, const Stretch& stretch, const double* damping, double* M, double* v, double* rows, double* d) {
    const int64_t w = stretch.eliminated, ahead = stretch.ahead(), rest = stretch.rest(), n = w + rest, m = stretch.width(), shared_width = stretch.shared_width;
    std::vector<double> vector(n);
    for (int64_t t = 0; t < stretch.frames; t++, rows += w * n, d += w) {
        shift_frame(stretch, stretch.used_columns(t), M, v, rows, vector.data());
        for (int64_t r = 0; r < w; r++) {
            const double* from = stretch.rows + (t * stretch.w + r) * m;
            double* to = rows + r * n;
            add(from + r, w - r, to + r);
            if (stretch.tied) add(from + stretch.w, w, to + w);
            for (int64_t k = 0; stretch.tied && k < stretch.fars; k++) to[2 * w + k] += from[2 * stretch.w + stretch.far[k]];
            add(from + m - shared_width, shared_width, to + w + ahead);
            add(from + w, stretch.w - w, to + stretch.extra_column(t));
            to[r] += damping[r], vector[r] -= stretch.gradient[t * stretch.w + r];
        }
        std::copy(v, v + rest, vector.begin() + w);
        if (!eliminate(blas, rows, vector.data(), static_cast<int>(n), stretch.used_columns(t), stretch.eliminated, M, static_cast<int>(rest))) return false;
        std::copy(vector.begin(), vector.begin() + w, d);
        std::copy(vector.begin() + w, vector.end(), v);
    }
    const double* next = stretch.rows + stretch.frames * stretch.w * m;  // factors of the stretch on the two frames after it
    for (int64_t r = 0; stretch.tied && r < w; r++, next += m) {
        add(next + r, w - r, M + r * rest + r);
        for (int64_t k = 0; k < stretch.fars; k++) M[r * rest + w + k] += next[stretch.w + stretch.far[k]];
        add(next + m - shared_width, shared_width, M + r * rest + ahead);
        v[r] -= stretch.gradient[stretch.frames * stretch.w + r];
    }
    next = stretch.rows + (stretch.frames + 1) * stretch.w * m;
    for (int64_t k = 0; stretch.tied && k < stretch.fars; k++) {
        const double* after = next + stretch.far[k] * m;
        double* to = M + (w + k) * rest;
        for (int64_t l = k; l < stretch.fars; l++) to[w + l] += after[stretch.far[l]];
        add(after + m - shared_width, shared_width, to + ahead);
        v[w + k] -= stretch.gradient[(stretch.frames + 1) * stretch.w + stretch.far[k]];
    }
    for (int64_t r = 0; r < shared_width; r++) {
        add(stretch.shared + r * shared_width + r, shared_width - r, M + (ahead + r) * rest + ahead + r);
        v[ahead + r] -= stretch.shared_gradient[r];
    }
    return true;
}

// Back-substitutes a stretch: `steps` (frames, eliminated) holds d and becomes the solution, given the steps `behind` of the
// two frames after the stretch (2, eliminated) and those of the border.
inline void substitute_stretch(const Blas& blas, const Stretch& stretch, double* rows, const double* behind, const double* shared, double* steps) {
    const int64_t w = stretch.eliminated, ahead = stretch.ahead(), n = w + stretch.rest();
    std::vector<double> later(stretch.rest());
    std::copy(shared, shared + stretch.s, later.begin() + ahead);
    for (int64_t t = stretch.frames - 1; t >= 0; t--) {
        const double* next = t + 1 < stretch.frames ? steps + (t + 1) * w : behind + (t + 1 - stretch.frames) * w;
        const double* after = t + 2 < stretch.frames ? steps + (t + 2) * w : behind + (t + 2 - stretch.frames) * w;
        if (stretch.tied) std::copy(next, next + w, later.begin());
        for (int64_t k = 0; stretch.tied && k < stretch.fars; k++) later[w + k] = after[stretch.far[k]];
        substitute(blas, rows + t * w * n, static_cast<int>(n), stretch.used_columns(t), stretch.eliminated, later.data(), steps + t * w);
    }
}

// Adds the upper triangle of a matrix with k columns to another matrix, where its columns have the ascending indices `places`.
inline void add_upper(const double* from, int64_t row, int64_t k, const int64_t* places, double* M, int64_t n) {
    for (int64_t first = 0, end; first < k; first = end) {  // runs of adjacent columns
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
