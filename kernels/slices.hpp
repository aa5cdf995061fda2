// Sums the equations of terms into slices or into the frames of a stretch (vip_factors/assembly/accumulator.py).
//
// A factor has derivatives by the twist of one bone in one to three frames, and by other columns of the slice. Products of
// twists are summed for each bone, accumulated along the skeleton towards the root, and multiplied by the joint screws at
// the end (composite inertias). Products of other columns are with_sums directly. Only the upper triangle is written.
#pragma once
#include <algorithm>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <vector>

#include "rotations.hpp"

#if defined(__linux__) && defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define VIP_WIDE __attribute__((target_clones("default", "avx2,fma")))  // selected at run time by the processor
#else
#define VIP_WIDE
#endif

namespace vip {

constexpr int JOINTS = 24, TWIST = 6, FRAMES = 3, SCREWS = JOINTS + 1;

// Product of x and a row of a symmetric matrix from the diagonal on. Adds the product of the mirrored column to y after the
// diagonal.
VIP_WIDE inline double times_upper(const double* __restrict row, int64_t n, const double* __restrict x, double* __restrict y) {
    double sums[8] = {row[0] * x[0]};
    int64_t j = 1;
    for (; j + 8 <= n; j += 8)
        for (int k = 0; k < 8; k++) sums[k] += row[j + k] * x[j + k], y[j + k] += row[j + k] * x[0];
    for (; j < n; j++) sums[0] += row[j] * x[j], y[j] += row[j] * x[0];
    return ((sums[0] + sums[1]) + (sums[2] + sums[3])) + ((sums[4] + sums[5]) + (sums[6] + sums[7]));
}

constexpr int PAIRS = 6;  // pairs of frames i ≤ j in a slice

inline int pair_of(int i, int j) { return i * FRAMES - i * (i - 1) / 2 + j - i; }

// Addresses of the rows of a slice's columns: three frames, then shared columns. Slices have separate rows. In a stretch
// consecutive slices overlap, and shared columns exist once.
struct Target {
    std::vector<double*> rows, gradients;  // by column, in the first slice
    std::vector<int64_t> row_step, gradient_step;  // strides from slice to slice
    std::vector<int> kind;  // by column: index into `orders`
    std::vector<std::vector<int64_t>> orders;  // position of each column in a row; negative if the two never meet
    int64_t frames;
    std::vector<int64_t> ahead;  // by column: frames between the slice's first frame and that of the row

    int64_t width() const { return static_cast<int64_t>(rows.size()); }
    double* row(int64_t t, int64_t column) const { return rows[column] + t * row_step[column]; }
    int64_t place(int64_t column, int64_t other) const {
        const int64_t position = orders[kind[column]][other];
        if (position < 0) throw std::out_of_range("two columns that never meet");
        return position;
    }
    double& gradient(int64_t t, int64_t column) const { return gradients[column][t * gradient_step[column]]; }

    // Throws unless the columns have rows at most `reach` frames ahead and are adjacent in every order.
    void expect_run(int64_t start, int64_t count, int64_t reach) const {
        if (start < 0 || start + count > width()) throw std::out_of_range("columns beyond those of a slice");
        for (int64_t c = start; c < start + count; c++)
            if (rows[c] == nullptr || ahead[c] > reach) throw std::out_of_range("columns without rows in these frames");
        for (const std::vector<int64_t>& order : orders)
            for (int64_t c = 1; c < count; c++)
                if (order[start] < 0 ? order[start + c] >= 0 : order[start + c] != order[start] + c)
                    throw std::out_of_range("columns that are not adjacent");
    }
};

// Blocks of variables, in the order of BLOCKS in vip_factors/assembly/compiled_sums.py.
enum Block { HEADINGS, MOUNTINGS, LENGTHS, PLACES, SOLE, HINGES, POSE_MEAN, POSES, HEADING, CAMERA_MOUNTING, CLOCK, CLOCK_DRIFT, ZOOM, PATH_SCALE, OFFSETS, BLOCKS };
constexpr int VIEWED = 4;  // blocks of a camera in reprojections: POSES, CLOCK, CLOCK_DRIFT, ZOOM

// Derivatives J (m, width) of a factor by adjacent columns of a slice. Their products with twists are summed at column
// `dense` of the bone's sums or, if `item_block` is not negative, separately for an item of that block.
struct Part {
    int64_t column;
    int width;
    const double* J;
    int dense = -1, item_block = -1, item = 0;
};

struct Rows {
    int m;
    double weight;
    const double* residual;  // (m)
    Part parts[8] = {};
    int count = 0;
    void add(const Part& part) {  // sorted by column; constant variables have a negative column
        if (part.column < 0) return;
        int at = count++;
        for (; at > 0 && parts[at - 1].column > part.column; at--) parts[at] = parts[at - 1];
        parts[at] = part;
    }
};

// Rotations (T, 24, 3, 3) and positions (T, 24, 3) of bones, and the charts of joint coordinates or null.
struct Bones {
    const double *R = nullptr, *p = nullptr, *turns = nullptr;
    int64_t frames = 0;
};

class BodySums {
  public:
    // begin: frame of the first slice. first: column of the body in a frame, negative if the body is constant. frame: width
    // of a frame. directions (24, 3, lengths): derivatives of joint offsets by the lengths, or null. cameras: first columns
    // of the VIEWED blocks of each camera that sees the body.
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
                    throw std::out_of_range("a body's rows are not adjacent");
        }
        shared_[0] = with_sums({columns_[LENGTHS], lengths_}), shared_[1] = with_sums({columns_[SOLE], 1});
        later_stride_ = stride_;
        for (int64_t i = 0; i < count * VIEWED; i++) cameras_[i] = with_sums({cameras[i], i % VIEWED ? 1 : TWIST});
        if (stride_ > MOST_SHARED) throw std::out_of_range("too many shared columns");
        if (!moves()) return;
        information_.resize(PAIRS * JOINTS * 36), coupling_.resize(FRAMES * JOINTS * TWIST * stride_);
        screws_.resize(FRAMES * SCREWS * 24), by_lengths_.resize(FRAMES * JOINTS * 3 * lengths_);
    }

    bool moves() const { return first_ >= 0; }
    int64_t frame(int64_t t) const { return begin_ + t; }
    const Bones& bones() const { return bones_; }
    const Target& target() const { return target_; }
    int lengths() const { return lengths_; }
    int64_t column(int frame, int64_t coordinate) const { return frame * frame_ + first_ + coordinate; }
    int64_t block(Block name) const { return columns_[name]; }
    // Throws unless a free block has `width` columns with rows at most `reach` frames ahead.
    void expect_block(Block name, int64_t width, int64_t reach = 0) const {
        if (columns_[name] >= 0) target_.expect_run(columns_[name], width, reach);
    }
    // Throws unless the free blocks of a camera have their columns.
    void expect_camera(int64_t camera) const {
        if (camera < 0 || (camera + 1) * VIEWED > static_cast<int64_t>(cameras_.size())) throw std::out_of_range("no such camera");
        for (int i = 0; i < VIEWED; i++)
            if (const ColumnRun& run = cameras_[camera * VIEWED + i]; run.column >= 0) target_.expect_run(run.column, run.width, 0);
    }
    // First column of the camera's pose, `ahead` frames after the slice's first frame if the camera moves.
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
        const ColumnRun& run = cameras_[camera * VIEWED + block];
        return {run.column, run.width, J, run.dense};
    }
    Part item_part(Block name, int width, const double* J, int slot, int factor) const {
        const int64_t item = item_blocks_[slot].items[factor];
        return {columns_[name] < 0 || item < 0 ? -1 : columns_[name] + item * width, width, J, -1, slot, factor};
    }

    // Registers a term, called with each slice by `expand`: slice by slice, sums stay in the cache.
    void add_term(std::function<void(int64_t)> term) { terms_.push_back(std::move(term)); }

    // Index of the sums of twists with a block in which each factor has its own item; terms with equal bones share them.
    int item_block(Block name, int width, const int64_t* bones, int64_t n, const int64_t* items = nullptr) {
        for (size_t i = 0; i < item_blocks_.size(); i++)
            if (item_blocks_[i].name == name && items == nullptr && std::equal(bones, bones + n, item_blocks_[i].bones.begin(), item_blocks_[i].bones.end()))
                return static_cast<int>(i);
        item_blocks_.push_back({name, width, std::vector<int64_t>(bones, bones + n), {}, {}});
        for (int64_t i = 0; i < n; i++) item_blocks_.back().items.push_back(items == nullptr ? i : items[i]);
        item_blocks_.back().sums.resize(FRAMES * n * TWIST * width);
        return static_cast<int>(item_blocks_.size()) - 1;
    }

    void point(int64_t f, int64_t bone, const double* p_bone, double* p_world) const {
        const double *R = bones_.R + 9 * (JOINTS * f + bone), *p = bones_.p + 3 * (JOINTS * f + bone);
        for (int r = 0; r < 3; r++) p_world[r] = p[r] + R[3 * r] * p_bone[0] + R[3 * r + 1] * p_bone[1] + R[3 * r + 2] * p_bone[2];
    }
    const double* rotation(int64_t f, int64_t bone) const { return bones_.R + 9 * (JOINTS * f + bone); }
    const double* root(int64_t f) const { return bones_.p + 3 * JOINTS * f; }

    // Derivative (3, lengths) of a point by lengths, given the derivative `shift` of its position on the bone.
    VIP_WIDE void by_lengths(int64_t f, int64_t bone, const double* shift, double* out) {
        const double *joints = joints_by_lengths(f) + bone * 3 * lengths_, *R = rotation(f, bone);
        for (int r = 0; r < 3; r++)
            for (int d = 0; d < lengths_; d++)
                out[r * lengths_ + d] = joints[r * lengths_ + d] + R[3 * r] * shift[d] + R[3 * r + 1] * shift[lengths_ + d] +
                                        R[3 * r + 2] * shift[2 * lengths_ + d];
    }

    // Adds rows with derivatives L (m, k) by a twist (k = 6) or by its rotation alone (k = 3).
    VIP_WIDE void add_twist(int64_t t, int64_t bone, int k, const double* L, const Rows& rows) {
        if (moves()) {
            double* info = information(0, bone);
            has_sums_[0] = true;
            for (int r = 0; r < rows.m; r++)
                for (int a = 0; a < k; a++) {
                    const double s = rows.weight * L[r * k + a];
                    for (int b = 0; b < k; b++) info[a * TWIST + b] += s * L[r * k + b];
                    double* into = coupling(0, bone) + a * stride_;
                    into[0] += s * rows.residual[r];
                    for (int i = 0; i < rows.count; i++) {
                        const Part& part = rows.parts[i];
                        const double* J = part.J + r * part.width;
                        double* to = part.item_block < 0 ? into + part.dense : item_sums(part, 0) + a * part.width;
                        for (int d = 0; d < part.width; d++) to[d] += s * J[d];
                    }
                }
        }
        add_direct(t, rows);
    }

    // Adds three rows that are linear in a point's positions in successive frames, with arms (groups, 3) from the root.
    VIP_WIDE void add_difference(int64_t t, int64_t bone, int groups, const double* c, const double* arms, const Rows& rows) {
        if (moves()) {
            for (int i = 0; i < groups; i++) {
                const double* a = arms + 3 * i;
                for (int j = i; j < groups; j++) {
                    const double *b = arms + 3 * j, s = rows.weight * c[i] * c[j], dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
                    double* info = information(pair_of(i, j), bone);
                    has_sums_[pair_of(i, j)] = true;
                    for (int r = 0; r < 3; r++)
                        for (int q = 0; q < 3; q++) info[6 * r + q] += s * ((r == q ? dot : 0.0) - b[r] * a[q]);
                    info[4] -= s * a[2], info[5] += s * a[1], info[9] += s * a[2];  // hat(a)
                    info[11] -= s * a[0], info[15] -= s * a[1], info[16] += s * a[0];
                    info[19] += s * b[2], info[20] -= s * b[1], info[24] -= s * b[2];  // −hat(b)
                    info[26] += s * b[0], info[30] += s * b[1], info[31] -= s * b[0];
                    for (int r = 3; r < 6; r++) info[7 * r] += s;
                }
                has_sums_[pair_of(i, i)] = true;
                const double s = rows.weight * c[i];
                auto add_transposed = [&](const double* v, int width, double* to, int step) {  // adds Jᵀ v, v (3, width)
                    for (int d = 0; d < width; d++) {
                        const double x = s * v[d], y = s * v[width + d], z = s * v[2 * width + d];
                        to[d] += a[1] * z - a[2] * y, to[step + d] += a[2] * x - a[0] * z, to[2 * step + d] += a[0] * y - a[1] * x;
                        to[3 * step + d] += x, to[4 * step + d] += y, to[5 * step + d] += z;
                    }
                };
                add_transposed(rows.residual, 1, coupling(i, bone), stride_);
                for (int q = 0; q < rows.count; q++) {
                    const Part& part = rows.parts[q];
                    if (part.item_block < 0) add_transposed(part.J, part.width, coupling(i, bone) + part.dense, stride_);
                    else add_transposed(part.J, part.width, item_sums(part, i), part.width);
                }
            }
        }
        add_direct(t, rows);
    }

    // Adds the products of columns other than twists.
    VIP_WIDE void add_direct(int64_t t, const Rows& rows) const {
        for (int i = 0; i < rows.count; i++)
            for (int a = 0; a < rows.parts[i].width; a++) {
                const Part& part = rows.parts[i];
                const int64_t column = part.column + a;
                double weighted[TWIST], sum = 0;
                for (int r = 0; r < rows.m; r++) {
                    weighted[r] = rows.weight * part.J[r * part.width + a];
                    sum += weighted[r] * rows.residual[r];
                }
                target_.gradient(t, column) += sum;
                double* row = target_.row(t, column);
                for (int j = i; j < rows.count; j++) {
                    const Part& other = rows.parts[j];
                    const int64_t position = target_.place(column, other.column);
                    for (int r = 0; r < rows.m; r++)
                        for (int b = i == j ? a : 0; b < other.width; b++)
                            row[position + b] += weighted[r] * other.J[r * other.width + b];
                }
            }
    }

    // First element of the block of the body in frame i with the body in frame j, and the stride of its rows.
    double* block_of(int64_t t, int i, int j) const {
        return target_.row(t, column(i, 0)) + target_.place(column(i, 0), column(j, 0));
    }
    int64_t row_width(int i) const { return target_.rows[column(i, 1)] - target_.rows[column(i, 0)]; }

    // Sums all terms and converts the sums to joint coordinates. In a stretch, sums on a pair of frames that two slices share
    // are converted once.
    void expand() {
        const bool stretch = moves() && target_.rows[column(1, 0)] == target_.row(1, column(0, 0));
        for (int64_t t = 0; t < target_.frames; t++) {
            clear(stretch && t > 0);
            for (const auto& term : terms_) term(t);
            const bool is_deferred = stretch && t + 1 < target_.frames;
            for (int i = 0; moves() && i < FRAMES && frame(t) + i < bones_.frames; i++) {
                for (int j = i; j < FRAMES && frame(t) + j < bones_.frames; j++) {
                    const int pair = pair_of(i, j);
                    if ((has_sums_[pair] || is_inherited_[pair]) && (i == 0 || !is_deferred))
                        expand_pair(t, i, j, screws(frame(t) + i), screws(frame(t) + j));
                }
                if (!has_sums_[pair_of(i, i)]) continue;
                const double* now = screws(frame(t) + i);
                expand_coupling(t, i, now);
                for (const ItemBlock& block : item_blocks_) expand_items(t, i, block, now);
            }
        }
    }

  private:
    struct ItemBlock {
        Block name;
        int width;
        std::vector<int64_t> bones, items;
        std::vector<double> sums;  // (FRAMES, n, 6, width)
    };
    struct ColumnRun {  // adjacent columns of a slice, at column `dense` of the bones' sums
        int64_t column;
        int width, dense = -1;
    };
    ColumnRun with_sums(ColumnRun run) {
        if (run.column >= 0) run.dense = stride_, stride_ += run.width;
        return run;
    }
    void put_run(int64_t t, int64_t column, const ColumnRun& run, const double* sums, int used) const {
        if (run.dense > 0 && run.dense < used) put_row(t, column, run.column, run.width, sums + run.dense);
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
    ColumnRun shared_[2] = {};        // lengths and sole
    std::vector<ColumnRun> cameras_;  // (count, VIEWED)
    int stride_ = 1, later_stride_ = 1;  // columns of the sums: gradient and all runs; those that later frames use
    std::vector<ItemBlock> item_blocks_;
    std::vector<double> information_, coupling_, screws_, by_lengths_;  // for one slice
    int64_t screws_of_[FRAMES] = {-1, -1, -1}, by_lengths_of_[FRAMES] = {-1, -1, -1};
    bool has_sums_[PAIRS] = {}, is_inherited_[PAIRS] = {};  // pairs of frames with sums from this slice and from earlier ones
    std::vector<std::function<void(int64_t)>> terms_;

    // Begins a slice; `inherits` keeps the previous slice's sums on pairs of frames after its first.
    void clear(bool inherits) {
        for (int i = 0; moves() && i < FRAMES; i++)
            for (int j = i; j < FRAMES; j++) {
                double* into = information(pair_of(i, j), 0);
                const int before = j + 1 < FRAMES ? pair_of(i + 1, j + 1) : -1;
                is_inherited_[pair_of(i, j)] = inherits && before >= 0 && (has_sums_[before] || is_inherited_[before]);
                if (is_inherited_[pair_of(i, j)]) std::copy(information(before, 0), information(before, 0) + JOINTS * 36, into);
                else std::fill(into, into + JOINTS * 36, 0.0);
            }
        std::fill(coupling_.begin(), coupling_.end(), 0.0);
        for (ItemBlock& block : item_blocks_) std::fill(block.sums.begin(), block.sums.end(), 0.0);
        std::fill(has_sums_, has_sums_ + PAIRS, false);
    }

    double* information(int pair, int64_t bone) { return &information_[(pair * JOINTS + bone) * TWIST * TWIST]; }
    double* coupling(int i, int64_t bone) { return &coupling_[(i * JOINTS + bone) * TWIST * stride_]; }
    double* item_sums(const Part& part, int i) {
        ItemBlock& block = item_blocks_[part.item_block];
        return &block.sums[(i * block.bones.size() + part.item) * TWIST * block.width];
    }

    const double* joints_by_lengths(int64_t f) {  // (24, 3, lengths)
        double* out = &by_lengths_[f % FRAMES * JOINTS * 3 * lengths_];
        if (by_lengths_of_[f % FRAMES] == f) return out;
        by_lengths_of_[f % FRAMES] = f;
        std::fill(out, out + 3 * lengths_, 0.0);
        for (int b = 1; b < JOINTS; b++)
            for (int r = 0; r < 3; r++)
                for (int d = 0; d < lengths_; d++) {
                    const double *R = rotation(f, parents_[b]) + 3 * r, *direction = directions_ + b * 3 * lengths_ + d;
                    out[(3 * b + r) * lengths_ + d] = out[(3 * parents_[b] + r) * lengths_ + d] + R[0] * direction[0] +
                                                      R[1] * direction[lengths_] + R[2] * direction[2 * lengths_];
                }
        return out;
    }

    // Screws (25, 6, 4) of the joint coordinates and of the root's translation; the fourth column is zero.
    VIP_WIDE const double* screws(int64_t f) {
        double* out = &screws_[f % FRAMES * SCREWS * 24];
        if (screws_of_[f % FRAMES] == f) return out;
        screws_of_[f % FRAMES] = f;
        for (int b = 0; b < JOINTS; b++) {
            const double *R = rotation(f, b), *p = bones_.p + 3 * (JOINTS * f + b), *p_root = root(f);
            const double arm[3] = {p[0] - p_root[0], p[1] - p_root[1], p[2] - p_root[2]};
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
            const double *inertia = I + 36 * (b < JOINTS ? b : 0), *S = later + 24 * b;
            double right[24], left[12];  // I S (6, 4), and Sᵀ I S (3, 4) with the earlier frame's screws
            for (int e = 0; e < 6; e++) {
                double sum[4] = {};
                for (int l = 0; l < 6; l++)
                    for (int c = 0; c < 4; c++) sum[c] += inertia[6 * e + l] * S[4 * l + c];
                for (int c = 0; c < 4; c++) right[4 * e + c] = sum[c];
            }
            // Joints that move the bone: its own and its ancestors'.
            for (int a = b; a >= 0 && a < JOINTS; a = static_cast<int>(parents_[a])) put(into, width, a, b, now + 24 * a, right);
            if (b == JOINTS) {
                put(into, width, b, b, now + 24 * b, right);
                break;
            }
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++)  // the translation is last, above the diagonal
                    if (i < j) into[(3 * JOINTS + r) * width + 3 * b + c] += right[12 + 4 * r + c];
                    else into[(3 * b + c) * width + 3 * JOINTS + r] += right[12 + 4 * r + c];
            if (i == j) continue;
            double earlier[24];  // Iᵀ S of the earlier frame
            for (int e = 0; e < 6; e++) {
                double sum[4] = {};
                for (int l = 0; l < 6; l++)
                    for (int c = 0; c < 4; c++) sum[c] += inertia[6 * l + e] * now[24 * b + 4 * l + c];
                for (int c = 0; c < 4; c++) earlier[4 * e + c] = sum[c];
            }
            for (int a = static_cast<int>(parents_[b]); a >= 0; a = static_cast<int>(parents_[a])) {
                for (int r = 0; r < 3; r++) {
                    double sum[4] = {};
                    for (int e = 0; e < 6; e++)
                        for (int c = 0; c < 4; c++) sum[c] += earlier[4 * e + r] * later[24 * a + 4 * e + c];
                    for (int c = 0; c < 4; c++) left[4 * r + c] = sum[c];
                }
                add3(into + 3 * b * width + 3 * a, width, left);
            }
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++) into[(3 * b + r) * width + 3 * JOINTS + c] += earlier[12 + 4 * c + r];
        }
    }

    VIP_WIDE void expand_coupling(int64_t t, int i, const double* S) {
        const int used = i == 0 ? stride_ : later_stride_;
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
                const int64_t row = column(i, 3 * b + c);
                target_.gradient(t, row) += sums[0];
                for (const ColumnRun& run : shared_) put_run(t, row, run, sums, used);
                for (const ColumnRun& run : cameras_) put_run(t, row, run, sums, used);
            }
    }

    VIP_WIDE void expand_items(int64_t t, int i, const ItemBlock& block, const double* S) {
        const int w = block.width;
        double sums[TWIST];
        for (size_t n = 0; n < block.bones.size(); n++) {
            const double* K = &block.sums[(i * block.bones.size() + n) * TWIST * w];
            if (block.items[n] < 0 || std::all_of(K, K + TWIST * w, [](double x) { return x == 0.0; })) continue;
            const int64_t start = columns_[block.name] + block.items[n] * w;
            for (int a = static_cast<int>(block.bones[n]);; a = a > 0 ? static_cast<int>(parents_[a]) : JOINTS) {
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

    // Adds values to a row of the body at the columns of a block; moving cameras follow the bodies in a frame.
    void put_row(int64_t t, int64_t column, int64_t start, int width, const double* values) const {
        double* into = target_.row(t, column) + target_.place(column, start);
        for (int d = 0; d < width; d++) into[d] += values[d];
    }

    static void add3(double* into, int64_t width, const double* block) {  // three columns of (3, 4)
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) into[r * width + c] += block[4 * r + c];
    }
    static void put(double* first, int64_t width, int a, int b, const double* S, const double* right) {  // adds Sᵀ (I S')
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
