// Equations of terms summed into slices, or into a chain's frames: vip_factors/assembly/accumulator.py and
// bone_blocks.py, factor by factor.
//
// A row of a factor has columns by the twists of one bone, in one to three frames, and columns of the slice. Products
// of the first are summed bone by bone, carried down the skeleton, and meet the screws of the joints last (composite
// inertias); products of the second go where they belong. Only what lies on and above the diagonal is written.
#pragma once
#include <algorithm>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <vector>

#include "rotations.hpp"

#if defined(__linux__) && defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define VIP_WIDE __attribute__((target_clones("default", "avx2,fma")))  // chosen by the processor that it runs on
#else
#define VIP_WIDE
#endif

namespace vip {

constexpr int JOINTS = 24, TWIST = 6, FRAMES = 3, SCREWS = JOINTS + 1, BODY = 3 * SCREWS, POSE = 3 * (JOINTS - 1);
// Of a row of a symmetric matrix from its diagonal on: its product with x; what its mirror adds to y behind the diagonal.
VIP_WIDE inline double times_upper(const double* __restrict row, int64_t n, const double* __restrict x, double* __restrict y) {
    double sums[8] = {row[0] * x[0]};
    int64_t j = 1;
    for (; j + 8 <= n; j += 8)
        for (int k = 0; k < 8; k++) sums[k] += row[j + k] * x[j + k], y[j + k] += row[j + k] * x[0];
    for (; j < n; j++) sums[0] += row[j] * x[j], y[j] += row[j] * x[0];
    return ((sums[0] + sums[1]) + (sums[2] + sums[3])) + ((sums[4] + sums[5]) + (sums[6] + sums[7]));
}

constexpr int PAIRS = 6;  // of frames i ≤ j of a slice

inline int pair_of(int i, int j) { return i * FRAMES - i * (i - 1) / 2 + j - i; }

// Where the columns of a slice, those of three frames and of what all frames share, have their rows. In slices each has
// its own; in a chain a column of the frame after is one of the next slice's frame, and what is shared is there once.
struct Target {
    std::vector<double*> rows, gradients;  // of each column, in the first slice
    std::vector<int64_t> row_step, gradient_step;  // from slice to slice
    std::vector<int> kind;  // of each column: which of the orders the elements of its row are in
    std::vector<std::vector<int64_t>> orders;  // where in a row each column is; below nought where it never is
    int64_t frames;

    int64_t width() const { return static_cast<int64_t>(rows.size()); }
    double* row(int64_t t, int64_t column) const { return rows[column] + t * row_step[column]; }
    int64_t place(int64_t column, int64_t other) const { return orders[kind[column]][other]; }
    double& gradient(int64_t t, int64_t column) const { return gradients[column][t * gradient_step[column]]; }
    void add(int64_t t, int64_t one, int64_t other, double value) const {
        const int64_t first = std::min(one, other), at = place(first, std::max(one, other));
        if (at < 0) throw std::out_of_range("two columns that never meet");
        row(t, first)[at] += value;
    }
};

// The rows of one factor: `groups` times `k` columns by a bone's twist, then `direct` ones of the slice.
struct Rows {
    int m, groups, k, direct;
    const double* J;  // (m, groups · k + direct)
    const double* residual;  // (m)
    const int64_t* columns;  // (direct)
    double weight;
};

class BodySums {
  public:
    // first: column of the body in a frame; frame: width of one; parents: of the joints, before them
    BodySums(const Target& target, int64_t first, int64_t frame, const int64_t* parents, int64_t others)
        : target_(target), first_(first), frame_(frame), parents_(parents, parents + JOINTS), others_(others),
          place_(target.width(), -1), information_(PAIRS * JOINTS * TWIST * TWIST), force_(FRAMES * JOINTS * TWIST),
          coupling_(FRAMES * JOINTS * TWIST * others) {}

    // What adds the rows of a slice, when all of that are summed: slice by slice they stay in the cache.
    void later(std::function<void(int64_t)> adds) { adds_.push_back(std::move(adds)); }

    VIP_WIDE void add(int64_t t, int64_t bone, const Rows& rows) {
        const int width = rows.groups * rows.k + rows.direct;
        for (int g = 0; g < rows.groups; g++) {
            for (int h = g; h < rows.groups; h++) {
                double* into = information(pair_of(g, h), bone);
                met_[pair_of(g, h)] = true;
                for (int a = 0; a < rows.k; a++)
                    for (int b = 0; b < rows.k; b++)
                        into[a * TWIST + b] += rows.weight * dot(rows, g * rows.k + a, h * rows.k + b, width);
            }
            for (int a = 0; a < rows.k; a++) {
                double sum = 0;
                for (int r = 0; r < rows.m; r++) sum += rows.J[r * width + g * rows.k + a] * rows.residual[r];
                force(g, bone)[a] += rows.weight * sum;
                double* into = coupling(g, bone) + a * others_;
                for (int d = 0; d < rows.direct; d++)
                    into[place(rows.columns[d])] +=
                        rows.weight * dot(rows, g * rows.k + a, rows.groups * rows.k + d, width);
            }
        }
        add_direct(target_, t, rows);
    }

    // What no bone has to do with.
    VIP_WIDE static void add_direct(const Target& target, int64_t t, const Rows& rows) {
        const int start = rows.groups * rows.k, width = start + rows.direct;
        for (int a = 0; a < rows.direct; a++) {
            double sum = 0;
            for (int r = 0; r < rows.m; r++) sum += rows.J[r * width + start + a] * rows.residual[r];
            const int64_t own = rows.columns[a];
            const int64_t* order = target.orders[target.kind[own]].data();
            double* into = target.row(t, own);
            target.gradient(t, own) += rows.weight * sum;
            for (int b = a; b < rows.direct; b++) {
                const int64_t other = rows.columns[b];
                const double value = rows.weight * dot(rows, start + a, start + b, width);
                if (other >= own && order[other] >= 0) into[order[other]] += value;
                else target.add(t, own, other, value);
            }
        }
    }

    // Sum all and carry it over to the joints, by screws (frames, 25, 6, 3), of so many frames from the first slice's on.
    void expand(const double* screws, int64_t frames) {
        for (int64_t t = 0; t < target_.frames; t++) {
            for (auto* sums : {&information_, &force_}) std::fill(sums->begin(), sums->end(), 0.0);
            for (int64_t row = 0; row < FRAMES * JOINTS * TWIST; row++)  // of columns that twists met before
                std::fill_n(&coupling_[row * others_], columns_.size(), 0.0);
            std::fill(met_, met_ + PAIRS, false);
            for (const auto& add : adds_) add(t);
            for (int i = 0; i < FRAMES && t + i < frames; i++) {
                const double* now = screws + (t + i) * SCREWS * 18;
                for (int j = i; j < FRAMES && t + j < frames; j++)
                    if (met_[pair_of(i, j)]) expand_pair(t, i, j, now, screws + (t + j) * SCREWS * 18);
                if (met_[pair_of(i, i)]) expand_others(t, i, now);
            }
        }
    }

    // D_iᵀ P D_j between the joints 1 … 23 of frames, and D_iᵀ of the force; D (23, 3, 3), P (69, 69).
    VIP_WIDE void add_joints(int64_t t, int i, int j, const double* D, const double* E, const double* P, double weight) {
        double half[3 * POSE], *const joints = block_of(t, i, j) + 3 * row_width(i) + 3;
        for (int a = 0; a < JOINTS - 1; a++) {
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < POSE; c++)
                    half[r * POSE + c] = weight * (D[9 * a + r] * P[(3 * a) * POSE + c] +
                                                   D[9 * a + 3 + r] * P[(3 * a + 1) * POSE + c] +
                                                   D[9 * a + 6 + r] * P[(3 * a + 2) * POSE + c]);
            for (int r = 0; r < 3; r++) {
                double* into = joints + (3 * a + r) * row_width(i);
                for (int b = i == j ? a : 0; b < JOINTS - 1; b++)
                    for (int c = 0; c < 3; c++)
                        into[3 * b + c] += half[r * POSE + 3 * b] * E[9 * b + c] +
                                           half[r * POSE + 3 * b + 1] * E[9 * b + 3 + c] +
                                           half[r * POSE + 3 * b + 2] * E[9 * b + 6 + c];
            }
        }
    }

    int64_t column(int frame, int64_t own) const { return frame * frame_ + first_ + own; }
    const Target& target() const { return target_; }

  private:
    const Target& target_;
    int64_t first_, frame_;
    std::vector<int64_t> parents_;
    int64_t others_;
    std::vector<int64_t> place_, columns_;  // of columns of the slice among those that twists meet, and back
    std::vector<double> information_, force_, coupling_;  // of one slice
    bool met_[PAIRS] = {};  // which pairs of frames have anything at all
    std::vector<std::function<void(int64_t)>> adds_;

    static double dot(const Rows& rows, int a, int b, int width) {
        double sum = 0;
        for (int r = 0; r < rows.m; r++) sum += rows.J[r * width + a] * rows.J[r * width + b];
        return sum;
    }
    double* information(int pair, int64_t bone) { return &information_[(pair * JOINTS + bone) * TWIST * TWIST]; }
    double* force(int i, int64_t bone) { return &force_[(i * JOINTS + bone) * TWIST]; }
    double* coupling(int i, int64_t bone) { return &coupling_[(i * JOINTS + bone) * TWIST * others_]; }
    // Of the body in frame i with that in frame j the first element, and from row to row of it.
    double* block_of(int64_t t, int i, int j) const {
        return target_.row(t, column(i, 0)) + target_.place(column(i, 0), column(j, 0));
    }
    int64_t row_width(int i) const { return target_.rows[column(i, 1)] - target_.rows[column(i, 0)]; }
    int64_t place(int64_t column) {
        if (place_[column] < 0) {
            if (static_cast<int64_t>(columns_.size()) == others_) throw std::out_of_range("a column too many");
            place_[column] = static_cast<int64_t>(columns_.size());
            columns_.push_back(column);
        }
        return place_[column];
    }

    VIP_WIDE void expand_pair(int64_t t, int i, int j, const double* now, const double* later) {
        double *I = information(pair_of(i, j), 0), *const into = block_of(t, i, j);
        const int64_t width = row_width(i);
        for (int b = JOINTS - 1; b > 0; b--)
            for (int e = 0; e < 36; e++) I[36 * parents_[b] + e] += I[36 * b + e];
        double right[18], left[18], block[9];
        for (int b = 0; b <= JOINTS; b++) {
            const double* own = I + 36 * (b < JOINTS ? b : 0);
            product<6, 6, 3>(own, later + 18 * b, right);
            // Of those that move the bone: itself, its ancestors, the root's translation.
            for (int a = b; a >= 0; a = a < JOINTS ? static_cast<int>(parents_[a]) : -1) {
                transposed_product(now + 18 * a, right, block);
                put(into, width, a, b, block);
            }
            if (b == JOINTS) break;
            transposed_product(now + 18 * JOINTS, right, block);
            if (i < j) {
                put(into, width, JOINTS, b, block);
                for (int r = 0; r < 3; r++)  // (Sᵀ I) with the later frame's screws
                    for (int c = 0; c < 6; c++) {
                        double sum = 0;
                        for (int e = 0; e < 6; e++) sum += now[18 * b + 3 * e + r] * own[6 * e + c];
                        left[6 * r + c] = sum;
                    }
                for (int a = static_cast<int>(parents_[b]); a >= 0; a = static_cast<int>(parents_[a])) {
                    product<3, 6, 3>(left, later + 18 * a, block);
                    put(into, width, b, a, block);
                }
                product<3, 6, 3>(left, later + 18 * JOINTS, block);
                put(into, width, b, JOINTS, block);
            } else {  // above the diagonal: the translation is last
                double mirrored[9];
                for (int r = 0; r < 3; r++)
                    for (int c = 0; c < 3; c++) mirrored[3 * r + c] = block[3 * c + r];
                put(into, width, b, JOINTS, mirrored);
            }
        }
    }

    VIP_WIDE void expand_others(int64_t t, int i, const double* screws) {
        const int64_t n = others_, used = static_cast<int64_t>(columns_.size());
        for (int b = JOINTS - 1; b > 0; b--) {
            for (int e = 0; e < TWIST; e++) force(i, parents_[b])[e] += force(i, b)[e];
            for (int e = 0; e < TWIST; e++) {
                double *into = coupling(i, parents_[b]) + e * n, *from = coupling(i, b) + e * n;
                for (int64_t d = 0; d < used; d++) into[d] += from[d];
            }
        }
        std::vector<double> sums(used);
        std::vector<int64_t> at(used);  // all columns of a body's frame have their rows in one order
        for (int64_t d = 0; d < used; d++)
            at[d] = columns_[d] > column(i, 0) ? target_.place(column(i, 0), columns_[d]) : -1;
        for (int b = 0; b <= JOINTS; b++) {
            const int bone = b < JOINTS ? b : 0;
            const double *S = screws + 18 * b, *f = force(i, bone), *C = coupling(i, bone);
            for (int c = 0; c < 3; c++) {
                const int64_t own = column(i, 3 * b + c);
                double pulled = 0;
                std::fill(sums.begin(), sums.end(), 0.0);
                for (int e = 0; e < TWIST; e++) {
                    pulled += S[3 * e + c] * f[e];
                    for (int64_t d = 0; d < used; d++) sums[d] += S[3 * e + c] * C[e * n + d];
                }
                target_.gradient(t, own) += pulled;
                double* into = target_.row(t, own);
                for (int64_t d = 0; d < used; d++)
                    if (at[d] >= 0) into[at[d]] += sums[d];
                    else if (sums[d] != 0.0) target_.add(t, own, columns_[d], sums[d]);
            }
        }
    }

    static void transposed_product(const double* S, const double* right, double* block) {
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) {
                double sum = 0;
                for (int e = 0; e < 6; e++) sum += S[3 * e + r] * right[3 * e + c];
                block[3 * r + c] = sum;
            }
    }
    static void put(double* first, int64_t width, int a, int b, const double* block) {
        for (int r = 0; r < 3; r++) {
            double* into = first + (3 * a + r) * width + 3 * b;
            for (int c = 0; c < 3; c++) into[c] += block[3 * r + c];
        }
    }
};

}  // namespace vip
