// Equations of terms summed into slices, or into the frames of a stretch: vip_factors/assembly/accumulator.py,
// factor by factor.
//
// A row of a factor has columns by the twists of one bone, in one to three frames, and columns of the slice. Products
// of the first are summed bone by bone, carried down the skeleton, and meet the screws of the joints last (composite
// inertias); products of the second go where they belong. What only one bone's factors see meets but the joints above
// that bone. Only what lies on and above the diagonal is written.
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

constexpr int JOINTS = 24, TWIST = 6, FRAMES = 3, SCREWS = JOINTS + 1;

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
// its own; in a stretch a column of the frame after is one of the next slice's frame, and what is shared is there once.
struct Target {
    std::vector<double*> rows, gradients;  // of each column, in the first slice
    std::vector<int64_t> row_step, gradient_step;  // from slice to slice
    std::vector<int> kind;  // of each column: which of the orders the elements of its row are in
    std::vector<std::vector<int64_t>> orders;  // where in a row each column is; below nought where it never is
    int64_t frames;
    std::vector<int64_t> ahead;  // of each column: frames after the slice's own in which its rows lie

    int64_t width() const { return static_cast<int64_t>(rows.size()); }
    double* row(int64_t t, int64_t column) const { return rows[column] + t * row_step[column]; }
    int64_t place(int64_t column, int64_t other) const {
        const int64_t found = orders[kind[column]][other];
        if (found < 0) throw std::out_of_range("two columns that never meet");
        return found;
    }
    double& gradient(int64_t t, int64_t column) const { return gradients[column][t * gradient_step[column]]; }

    // Throws unless these columns have rows at most `reach` frames ahead and stand side by side wherever they stand.
    void expect_run(int64_t start, int64_t count, int64_t reach) const {
        if (start < 0 || start + count > width()) throw std::out_of_range("columns beyond those of a slice");
        for (int64_t c = start; c < start + count; c++)
            if (rows[c] == nullptr || ahead[c] > reach) throw std::out_of_range("columns without rows in these frames");
        for (const std::vector<int64_t>& order : orders)
            for (int64_t c = 1; c < count; c++)
                if (order[start] < 0 ? order[start + c] >= 0 : order[start + c] != order[start] + c)
                    throw std::out_of_range("columns that are not side by side");
    }
};

// Blocks of variables, in the order of vip_factors/assembly/compiled_sums.py.
enum Block { HEADINGS, MOUNTINGS, LENGTHS, PLACES, SOLE, HINGES, POSE_MEAN, POSES, HEADING, CAMERA_MOUNTING, CLOCK, CLOCK_DRIFT, ZOOM, PATH_SCALE, OFFSETS, BLOCKS };
constexpr int VIEWED = 4;  // blocks that reprojections of a camera see: POSES, CLOCK, CLOCK_DRIFT, ZOOM

// Derivatives (m, width) of a factor by columns of the slice from one on. Twists meet all such parts of factors in sums
// of bones, from column `dense` of these on; or, if `each` is not below nought, apart for each item of a block.
struct Part {
    int64_t column;
    int width;
    const double* J;
    int dense = -1, each = -1, item = 0;
};

struct Rows {
    int m;
    double weight;
    const double* residual;  // (m)
    Part parts[8] = {};
    int count = 0;
    void add(const Part& part) {  // in the order of columns; nothing of what does not move
        if (part.column < 0) return;
        int at = count++;
        for (; at > 0 && parts[at - 1].column > part.column; at--) parts[at] = parts[at - 1];
        parts[at] = part;
    }
};

// Rotations (T, 24, 3, 3) and places (T, 24, 3) of bones; by coordinates of the joints, if there are charts.
struct Bones {
    const double *R = nullptr, *p = nullptr, *turns = nullptr;
    int64_t frames = 0;
};

class BodySums {
  public:
    // begin: frame of the first slice; first: column of the body in a frame, below nought of one that is kept; frame:
    // width of one; directions (24, 3, lengths): how joints' offsets change with lengths, if these move; cameras: of each
    // that sees the body, first columns of its VIEWED blocks
    BodySums(const Target& target, int64_t begin, const Bones& bones, int64_t first, int64_t frame, const int64_t* parents,
             const int64_t* columns, const double* directions, int lengths, const int64_t* cameras, int64_t count)
        : target_(target), begin_(begin), bones_(bones), first_(first), frame_(frame), parents_(parents, parents + JOINTS),
          directions_(directions), lengths_(directions == nullptr || columns[LENGTHS] < 0 ? 0 : lengths),
          cameras_(count * VIEWED) {
        std::copy(columns, columns + BLOCKS, columns_);
        for (int i = 0; moves() && i < FRAMES; i++) {
            target.expect_run(column(i, 0), 3 * SCREWS, i);
            for (int64_t c = 1; c < 3 * SCREWS; c++)
                if (target.rows[column(i, c)] - target.rows[column(i, c - 1)] != row_width(i) || target.kind[column(i, c)] != target.kind[column(i, 0)])
                    throw std::out_of_range("a body's rows are not side by side");
        }
        shared_[0] = added({columns_[LENGTHS], lengths_}), shared_[1] = added({columns_[SOLE], 1});
        later_ = stride_;
        for (int64_t i = 0; i < count * VIEWED; i++) cameras_[i] = added({cameras[i], i % VIEWED ? 1 : TWIST});
        if (stride_ > MOST_SHARED) throw std::out_of_range("a column too many");
        if (!moves()) return;
        information_.resize(PAIRS * JOINTS * 36), coupling_.resize(FRAMES * JOINTS * TWIST * stride_);
        screws_.resize(FRAMES * SCREWS * 24), by_lengths_.resize(FRAMES * JOINTS * 3 * lengths_);
    }

    bool moves() const { return first_ >= 0; }
    int64_t frame(int64_t t) const { return begin_ + t; }
    const Bones& bones() const { return bones_; }
    const Target& target() const { return target_; }
    int lengths() const { return lengths_; }
    int64_t column(int frame, int64_t own) const { return frame * frame_ + first_ + own; }
    int64_t block(Block name) const { return columns_[name]; }
    // Throws unless a block that moves has so many columns, with rows at most `reach` frames ahead.
    void expect_block(Block name, int64_t width, int64_t reach = 0) const {
        if (columns_[name] >= 0) target_.expect_run(columns_[name], width, reach);
    }
    // Throws unless a camera's blocks that move have their columns.
    void expect_camera(int64_t camera) const {
        if (camera < 0 || (camera + 1) * VIEWED > static_cast<int64_t>(cameras_.size())) throw std::out_of_range("no such camera");
        for (int i = 0; i < VIEWED; i++)
            if (const Run& run = cameras_[camera * VIEWED + i]; run.column >= 0) target_.expect_run(run.column, run.width, 0);
    }
    // Of a camera's pose, in a frame after that of the slice where it moves.
    int64_t pose(int ahead) const {
        return columns_[POSES] < 0 ? -1 : columns_[POSES] + (columns_[POSES] < FRAMES * frame_ ? ahead * frame_ : 0);
    }
    void expect_poses(int frames) const {
        for (int ahead = 0; pose(0) >= 0 && ahead < frames; ahead++) target_.expect_run(pose(ahead), TWIST, ahead);
    }
    Part part(Block name, int width, const double* J) const {
        return {columns_[name], width, J, name == LENGTHS ? shared_[0].dense : name == SOLE ? shared_[1].dense : -1};
    }
    Part part_of_camera(int64_t camera, int block, const double* J) const {  // block: 0 … VIEWED - 1
        const Run& run = cameras_[camera * VIEWED + block];
        return {run.column, run.width, J, run.dense};
    }
    Part part_of_each(Block name, int width, const double* J, int slot, int item) const {
        const int64_t of_item = each_[slot].items[item];
        return {columns_[name] < 0 || of_item < 0 ? -1 : columns_[name] + of_item * width, width, J, -1, slot, item};
    }

    // What adds a slice's rows, when all are summed: slice by slice they stay in the cache.
    void later(std::function<void(int64_t)> adds) { adds_.push_back(std::move(adds)); }

    // Where twists of bones meet a block of which every factor has an item of its own; the same for alike factors.
    int each(Block name, int width, const int64_t* bones, int64_t n, const int64_t* items = nullptr) {
        for (size_t i = 0; i < each_.size(); i++)
            if (each_[i].name == name && items == nullptr && std::equal(bones, bones + n, each_[i].bones.begin(), each_[i].bones.end()))
                return static_cast<int>(i);
        each_.push_back({name, width, std::vector<int64_t>(bones, bones + n), {}, {}});
        for (int64_t i = 0; i < n; i++) each_.back().items.push_back(items == nullptr ? i : items[i]);
        each_.back().sums.resize(FRAMES * n * TWIST * width);
        return static_cast<int>(each_.size()) - 1;
    }

    void point(int64_t f, int64_t bone, const double* p_bone, double* p_world) const {
        const double *R = bones_.R + 9 * (JOINTS * f + bone), *p = bones_.p + 3 * (JOINTS * f + bone);
        for (int r = 0; r < 3; r++) p_world[r] = p[r] + R[3 * r] * p_bone[0] + R[3 * r + 1] * p_bone[1] + R[3 * r + 2] * p_bone[2];
    }
    const double* rotation(int64_t f, int64_t bone) const { return bones_.R + 9 * (JOINTS * f + bone); }
    const double* root(int64_t f) const { return bones_.p + 3 * JOINTS * f; }

    // A point (3, lengths) by lengths, given how it shifts on its bone.
    VIP_WIDE void by_lengths(int64_t f, int64_t bone, const double* shift, double* out) {
        const double *joints = joints_by_lengths(f) + bone * 3 * lengths_, *R = rotation(f, bone);
        for (int r = 0; r < 3; r++)
            for (int d = 0; d < lengths_; d++)
                out[r * lengths_ + d] = joints[r * lengths_ + d] + R[3 * r] * shift[d] + R[3 * r + 1] * shift[lengths_ + d] +
                                        R[3 * r + 2] * shift[2 * lengths_ + d];
    }

    // Rows (m, k) by a twist, or by its turn alone.
    VIP_WIDE void add_twist(int64_t t, int64_t bone, int k, const double* L, const Rows& rows) {
        if (moves()) {
            double* info = information(0, bone);
            met_[0] = true;
            for (int r = 0; r < rows.m; r++)
                for (int a = 0; a < k; a++) {
                    const double s = rows.weight * L[r * k + a];
                    for (int b = 0; b < k; b++) info[a * TWIST + b] += s * L[r * k + b];
                    double* into = coupling(0, bone) + a * stride_;
                    into[0] += s * rows.residual[r];
                    for (int i = 0; i < rows.count; i++) {
                        const Part& part = rows.parts[i];
                        const double* J = part.J + r * part.width;
                        double* to = part.each < 0 ? into + part.dense : each_sums(part, 0) + a * part.width;
                        for (int d = 0; d < part.width; d++) to[d] += s * J[d];
                    }
                }
        }
        add_direct(t, rows);
    }

    // Three rows that are linear in where a point is in successive frames: arms (groups, 3) from the root.
    VIP_WIDE void add_difference(int64_t t, int64_t bone, int groups, const double* c, const double* arms, const Rows& rows) {
        if (moves()) {
            for (int i = 0; i < groups; i++) {
                const double* a = arms + 3 * i;
                for (int j = i; j < groups; j++) {
                    const double *b = arms + 3 * j, s = rows.weight * c[i] * c[j], dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
                    double* info = information(pair_of(i, j), bone);
                    met_[pair_of(i, j)] = true;
                    for (int r = 0; r < 3; r++)
                        for (int q = 0; q < 3; q++) info[6 * r + q] += s * ((r == q ? dot : 0.0) - b[r] * a[q]);
                    info[4] -= s * a[2], info[5] += s * a[1], info[9] += s * a[2];  // hat of the one
                    info[11] -= s * a[0], info[15] -= s * a[1], info[16] += s * a[0];
                    info[19] += s * b[2], info[20] -= s * b[1], info[24] -= s * b[2];  // and of the other, turned round
                    info[26] += s * b[0], info[30] += s * b[1], info[31] -= s * b[0];
                    for (int r = 3; r < 6; r++) info[7 * r] += s;
                }
                met_[pair_of(i, i)] = true;
                const double s = rows.weight * c[i];
                auto pull = [&](const double* v, int width, double* to, int step) {  // v (3, width): Jᵀ v
                    for (int d = 0; d < width; d++) {
                        const double x = s * v[d], y = s * v[width + d], z = s * v[2 * width + d];
                        to[d] += a[1] * z - a[2] * y, to[step + d] += a[2] * x - a[0] * z, to[2 * step + d] += a[0] * y - a[1] * x;
                        to[3 * step + d] += x, to[4 * step + d] += y, to[5 * step + d] += z;
                    }
                };
                pull(rows.residual, 1, coupling(i, bone), stride_);
                for (int q = 0; q < rows.count; q++) {
                    const Part& part = rows.parts[q];
                    if (part.each < 0) pull(part.J, part.width, coupling(i, bone) + part.dense, stride_);
                    else pull(part.J, part.width, each_sums(part, i), part.width);
                }
            }
        }
        add_direct(t, rows);
    }

    // What no bone has to do with.
    VIP_WIDE void add_direct(int64_t t, const Rows& rows) const {
        for (int i = 0; i < rows.count; i++)
            for (int a = 0; a < rows.parts[i].width; a++) {
                const Part& one = rows.parts[i];
                const int64_t own = one.column + a;
                double pushed[TWIST], sum = 0;
                for (int r = 0; r < rows.m; r++) {
                    pushed[r] = rows.weight * one.J[r * one.width + a];
                    sum += pushed[r] * rows.residual[r];
                }
                target_.gradient(t, own) += sum;
                double* row = target_.row(t, own);
                for (int j = i; j < rows.count; j++) {
                    const Part& other = rows.parts[j];
                    const int64_t at = target_.place(own, other.column);
                    for (int r = 0; r < rows.m; r++)
                        for (int b = i == j ? a : 0; b < other.width; b++)
                            row[at + b] += pushed[r] * other.J[r * other.width + b];
                }
            }
    }

    // Of the body in frame i with that in frame j the first element, and from row to row of it.
    double* block_of(int64_t t, int i, int j) const {
        return target_.row(t, column(i, 0)) + target_.place(column(i, 0), column(j, 0));
    }
    int64_t row_width(int i) const { return target_.rows[column(i, 1)] - target_.rows[column(i, 0)]; }

    // Sum all, and carry it over to the joints. In a stretch what two slices know of the same two frames goes there once.
    void expand() {
        const bool stretch = moves() && target_.rows[column(1, 0)] == target_.row(1, column(0, 0));
        for (int64_t t = 0; t < target_.frames; t++) {
            clear(stretch && t > 0);
            for (const auto& add : adds_) add(t);
            const bool waits = stretch && t + 1 < target_.frames;
            for (int i = 0; moves() && i < FRAMES && frame(t) + i < bones_.frames; i++) {
                for (int j = i; j < FRAMES && frame(t) + j < bones_.frames; j++) {
                    const int pair = pair_of(i, j);
                    if ((met_[pair] || handed_on_[pair]) && (i == 0 || !waits))
                        expand_pair(t, i, j, screws(frame(t) + i), screws(frame(t) + j));
                }
                if (!met_[pair_of(i, i)]) continue;
                const double* now = screws(frame(t) + i);
                expand_others(t, i, now);
                for (const Each& one : each_) expand_each(t, i, one, now);
            }
        }
    }

  private:
    struct Each {
        Block name;
        int width;
        std::vector<int64_t> bones, items;
        std::vector<double> sums;  // (FRAMES, n, 6, width)
    };
    struct Run {  // columns that bones' sums meet from column `dense` of theirs on
        int64_t column;
        int width, dense = -1;
    };
    Run added(Run run) {
        if (run.column >= 0) run.dense = stride_, stride_ += run.width;
        return run;
    }
    void put_run(int64_t t, int64_t own, const Run& run, const double* sums, int used) const {
        if (run.dense > 0 && run.dense < used) put_row(t, own, run.column, run.width, sums + run.dense);
    }
    static constexpr int MOST_SHARED = 256;
    const Target& target_;
    int64_t begin_;
    Bones bones_;
    int64_t first_, frame_;
    std::vector<int64_t> parents_;
    const double* directions_;
    int lengths_;
    int64_t columns_[BLOCKS];
    Run shared_[2] = {};        // lengths and sole
    std::vector<Run> cameras_;  // (count, VIEWED)
    int stride_ = 1, later_ = 1;  // of the force and all runs, and of those that frames after the first meet
    std::vector<Each> each_;
    std::vector<double> information_, coupling_, screws_, by_lengths_;  // of one slice
    int64_t screws_of_[FRAMES] = {-1, -1, -1}, by_lengths_of_[FRAMES] = {-1, -1, -1};
    bool met_[PAIRS] = {}, handed_on_[PAIRS] = {};  // which pairs of frames have anything at all, from this slice and before
    std::vector<std::function<void(int64_t)>> adds_;

    // Begin a slice: of pairs of frames behind the first of the one before with what that knew of them.
    void clear(bool handed_on) {
        for (int i = 0; moves() && i < FRAMES; i++)
            for (int j = i; j < FRAMES; j++) {
                double* into = information(pair_of(i, j), 0);
                const int before = j + 1 < FRAMES ? pair_of(i + 1, j + 1) : -1;
                handed_on_[pair_of(i, j)] = handed_on && before >= 0 && (met_[before] || handed_on_[before]);
                if (handed_on_[pair_of(i, j)]) std::copy(information(before, 0), information(before, 0) + JOINTS * 36, into);
                else std::fill(into, into + JOINTS * 36, 0.0);
            }
        std::fill(coupling_.begin(), coupling_.end(), 0.0);
        for (Each& one : each_) std::fill(one.sums.begin(), one.sums.end(), 0.0);
        std::fill(met_, met_ + PAIRS, false);
    }

    double* information(int pair, int64_t bone) { return &information_[(pair * JOINTS + bone) * TWIST * TWIST]; }
    double* coupling(int i, int64_t bone) { return &coupling_[(i * JOINTS + bone) * TWIST * stride_]; }
    double* each_sums(const Part& part, int i) {
        Each& one = each_[part.each];
        return &one.sums[(i * one.bones.size() + part.item) * TWIST * one.width];
    }

    const double* joints_by_lengths(int64_t f) {  // (24, 3, lengths)
        double* out = &by_lengths_[f % FRAMES * JOINTS * 3 * lengths_];
        if (by_lengths_of_[f % FRAMES] == f) return out;
        by_lengths_of_[f % FRAMES] = f;
        std::fill(out, out + 3 * lengths_, 0.0);
        for (int b = 1; b < JOINTS; b++)
            for (int r = 0; r < 3; r++)
                for (int d = 0; d < lengths_; d++) {
                    const double *R = rotation(f, parents_[b]) + 3 * r, *own = directions_ + b * 3 * lengths_ + d;
                    out[(3 * b + r) * lengths_ + d] = out[(3 * parents_[b] + r) * lengths_ + d] + R[0] * own[0] +
                                                      R[1] * own[lengths_] + R[2] * own[2 * lengths_];
                }
        return out;
    }

    // How joints move the bones beyond them: (25, 6, 4), of which the fourth column is nought.
    VIP_WIDE const double* screws(int64_t f) {
        double* out = &screws_[f % FRAMES * SCREWS * 24];
        if (screws_of_[f % FRAMES] == f) return out;
        screws_of_[f % FRAMES] = f;
        for (int b = 0; b < JOINTS; b++) {
            const double *R = rotation(f, b), *p = bones_.p + 3 * (JOINTS * f + b), *root_of = root(f);
            const double arm[3] = {p[0] - root_of[0], p[1] - root_of[1], p[2] - root_of[2]};
            double turned[9];
            if (bones_.turns != nullptr) product<3, 3, 3>(R, bones_.turns + 9 * (JOINTS * f + b), turned), R = turned;
            double* S = out + 24 * b;
            for (int c = 0; c < 3; c++) {
                for (int r = 0; r < 3; r++) S[4 * r + c] = R[3 * r + c];
                for (int r = 0; r < 3; r++) {
                    const int u = (r + 1) % 3, v = (r + 2) % 3;
                    S[12 + 4 * r + c] = arm[u] * R[3 * v + c] - arm[v] * R[3 * u + c];
                }
            }
        }
        for (int c = 0; c < 3; c++) out[24 * JOINTS + 12 + 5 * c] = 1.0;
        return out;
    }

    VIP_WIDE void expand_pair(int64_t t, int i, int j, const double* now, const double* later) {
        double *I = information(pair_of(i, j), 0), *const into = block_of(t, i, j);
        const int64_t width = row_width(i);
        for (int b = JOINTS - 1; b > 0; b--)
            for (int e = 0; e < 36; e++) I[36 * parents_[b] + e] += I[36 * b + e];
        for (int b = 0; b <= JOINTS; b++) {
            const double *own = I + 36 * (b < JOINTS ? b : 0), *S = later + 24 * b;
            double right[24], left[12];  // I S, and Sᵀ I of the frame before, transposed: (6, 4) and (3, 4)
            for (int e = 0; e < 6; e++) {
                double sum[4] = {};
                for (int l = 0; l < 6; l++)
                    for (int c = 0; c < 4; c++) sum[c] += own[6 * e + l] * S[4 * l + c];
                for (int c = 0; c < 4; c++) right[4 * e + c] = sum[c];
            }
            // Of those that move the bone: itself, its ancestors, the root's translation.
            for (int a = b; a >= 0 && a < JOINTS; a = static_cast<int>(parents_[a])) put(into, width, a, b, now + 24 * a, right);
            if (b == JOINTS) {
                put(into, width, b, b, now + 24 * b, right);
                break;
            }
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++)  // above the diagonal: the translation is last
                    if (i < j) into[(3 * JOINTS + r) * width + 3 * b + c] += right[12 + 4 * r + c];
                    else into[(3 * b + c) * width + 3 * JOINTS + r] += right[12 + 4 * r + c];
            if (i == j) continue;
            double turned[24];  // Iᵀ S of the frame before
            for (int e = 0; e < 6; e++) {
                double sum[4] = {};
                for (int l = 0; l < 6; l++)
                    for (int c = 0; c < 4; c++) sum[c] += own[6 * l + e] * now[24 * b + 4 * l + c];
                for (int c = 0; c < 4; c++) turned[4 * e + c] = sum[c];
            }
            for (int a = static_cast<int>(parents_[b]); a >= 0; a = static_cast<int>(parents_[a])) {
                for (int r = 0; r < 3; r++) {
                    double sum[4] = {};
                    for (int e = 0; e < 6; e++)
                        for (int c = 0; c < 4; c++) sum[c] += turned[4 * e + r] * later[24 * a + 4 * e + c];
                    for (int c = 0; c < 4; c++) left[4 * r + c] = sum[c];
                }
                add3(into + 3 * b * width + 3 * a, width, left);
            }
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++) into[(3 * b + r) * width + 3 * JOINTS + c] += turned[12 + 4 * c + r];
        }
    }

    VIP_WIDE void expand_others(int64_t t, int i, const double* S) {
        const int used = i == 0 ? stride_ : later_;
        double* C = coupling(i, 0);
        for (int b = JOINTS - 1; b > 0; b--)
            for (int e = 0; e < TWIST; e++)
                for (int d = 0; d < used; d++) C[(parents_[b] * TWIST + e) * stride_ + d] += C[(b * TWIST + e) * stride_ + d];
        double sums[MOST_SHARED];
        for (int b = 0; b <= JOINTS; b++)
            for (int c = 0; c < 3; c++) {
                const double *from = coupling(i, b < JOINTS ? b : 0), *screw = S + 24 * b + c;
                std::fill(sums, sums + used, 0.0);
                for (int e = 0; e < TWIST; e++)
                    for (int d = 0; d < used; d++) sums[d] += screw[4 * e] * from[e * stride_ + d];
                const int64_t own = column(i, 3 * b + c);
                target_.gradient(t, own) += sums[0];
                for (const Run& run : shared_) put_run(t, own, run, sums, used);
                for (const Run& run : cameras_) put_run(t, own, run, sums, used);
            }
    }

    VIP_WIDE void expand_each(int64_t t, int i, const Each& one, const double* S) {
        const int w = one.width;
        double sums[TWIST];
        for (size_t n = 0; n < one.bones.size(); n++) {
            const double* K = &one.sums[(i * one.bones.size() + n) * TWIST * w];
            if (one.items[n] < 0 || std::all_of(K, K + TWIST * w, [](double x) { return x == 0.0; })) continue;
            const int64_t start = columns_[one.name] + one.items[n] * w;
            for (int a = static_cast<int>(one.bones[n]);; a = a > 0 ? static_cast<int>(parents_[a]) : JOINTS) {
                for (int c = 0; c < 3; c++) {
                    std::fill(sums, sums + w, 0.0);
                    for (int e = 0; e < TWIST; e++)
                        for (int d = 0; d < w; d++) sums[d] += S[24 * a + 4 * e + c] * K[e * w + d];
                    put_row(t, column(i, 3 * a + c), start, w, sums);
                }
                if (a == JOINTS) break;
            }
        }
    }

    // A row of the body's with columns of a block; a camera that moves is behind bodies in a frame.
    void put_row(int64_t t, int64_t own, int64_t start, int width, const double* values) const {
        double* into = target_.row(t, own) + target_.place(own, start);
        for (int d = 0; d < width; d++) into[d] += values[d];
    }

    static void add3(double* into, int64_t width, const double* block) {  // of (3, 4) three columns
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) into[r * width + c] += block[4 * r + c];
    }
    static void put(double* first, int64_t width, int a, int b, const double* S, const double* right) {  // Sᵀ (I S')
        double block[12];
        for (int r = 0; r < 3; r++) {
            double sum[4] = {};
            for (int e = 0; e < 6; e++)
                for (int c = 0; c < 4; c++) sum[c] += S[4 * e + r] * right[4 * e + c];
            for (int c = 0; c < 4; c++) block[4 * r + c] = sum[c];
        }
        add3(first + 3 * a * width + 3 * b, width, block);
    }
};

}  // namespace vip
