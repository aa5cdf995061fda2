// Compiled terms: item_block adds the factors that begin in a slice's first frame. They repeat vip_factors/terms/*.py, where the
// equations are derived. Arrays hold all frames; factors that need frames after the last one are left out.
#pragma once
#include <nanobind/ndarray.h>

#include "joints.hpp"

namespace vip {

namespace nb = nanobind;
template <int N> using In = nb::ndarray<const double, nb::ndim<N>, nb::c_contig, nb::device::cpu>;
template <int N> using Out = nb::ndarray<double, nb::ndim<N>, nb::c_contig, nb::device::cpu>;
template <int N> using Indices = nb::ndarray<const int64_t, nb::ndim<N>, nb::c_contig, nb::device::cpu>;
using Mask = nb::ndarray<const bool, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

using FrameMask = nb::ndarray<const bool, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Checks of arguments: a wrong shape or index raises ValueError and never reads past the end of an array.
inline void expect(bool condition, const char* message = "shapes do not match") {
    if (!condition) throw nb::value_error(message);
}

constexpr int64_t ANY = -1;  // any length of an axis

template <class Array> inline bool has_shape(const Array& array, std::initializer_list<int64_t> shape) {
    if (array.ndim() != shape.size()) return false;
    size_t axis = 0;
    for (const int64_t length : shape)
        if (const auto actual = static_cast<int64_t>(array.shape(axis++)); length != ANY && actual != length) return false;
    return true;
}

template <class Array> inline void expect_shape(const Array& array, std::initializer_list<int64_t> shape) {
    expect(has_shape(array, shape));
}

inline void expect_within(const Indices<1>& indices, int64_t first, int64_t end) {
    for (size_t i = 0; i < indices.size(); i++) expect(indices(i) >= first && indices(i) < end, "an index is out of range");
}

// Parents precede their children; the root has a negative parent.
inline void expect_parents(const Indices<1>& parents) {
    expect(parents.size() > 0 && parents(0) < 0, "the first joint must be the root");
    for (size_t j = 1; j < parents.size(); j++)
        expect(parents(j) >= 0 && parents(j) < static_cast<int64_t>(j), "a parent must come before its child");
}

// Weight of a factor: confidence times information scale of its frame, times the robust loss, whose constant is scaled by the
// root of the information scale (vip_factors/terms/robust.py).
struct RobustLoss {
    char loss;
    double k, share;
    double weight(double confidence, const double* residual, int m) const {
        confidence *= share;
        if (loss == 's' || confidence == 0) return confidence;
        double square = 0;
        for (int i = 0; i < m; i++) square += residual[i] * residual[i];
        const double norm = std::sqrt(confidence * square), limit = k * std::sqrt(share);
        if (loss == 'h') return confidence * std::min(1.0, limit / std::max(norm, 1e-300));
        return confidence / (1 + norm / limit * (norm / limit));
    }
};

// Element of frame t in an array with one element for every frame, or with a constant element.
template <class Array> inline const double* in_frame(const Array& array, int64_t t) {
    return array.data() + (array.shape(0) > 1 ? t : 0) * static_cast<int64_t>(array.size() / std::max<size_t>(array.shape(0), 1));
}

inline void scale(double* values, int n, double factor) {
    for (int i = 0; i < n; i++) values[i] *= factor;
}

// J (m, c) times a chart (c, c), in place; a null chart changes nothing.
template <int m, int c> inline void by_chart(double* J, const double* chart) {
    double out[m * c];
    if (chart == nullptr) return;
    product<m, c, c>(J, chart, out);
    std::copy(out, out + m * c, J);
}

// Log(R M (Rz(γ) S)ᵀ) / sigma, and its derivatives by R (on the left), by M (on the right) and by γ.
struct AttitudeError {
    double residual[3], by_turn[9], by_mounting[9], by_heading[3];
    AttitudeError(const double* R, const double* mounting, double heading, const double* measured, double sigma) {
        const double c = std::cos(heading), s = std::sin(heading);
        double turned[9], transposed[9], error[9], right[9], sensor[9];
        for (int i = 0; i < 3; i++)
            turned[i] = c * measured[i] - s * measured[3 + i], turned[3 + i] = s * measured[i] + c * measured[3 + i], turned[6 + i] = measured[6 + i];
        product<3, 3, 3>(R, mounting, sensor);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) transposed[3 * i + j] = turned[3 * j + i];
        product<3, 3, 3>(sensor, transposed, error);
        log(error, residual);
        inverse_right_jacobian(residual, right);
        for (int i = 0; i < 3; i++) {
            residual[i] /= sigma, by_heading[i] = -right[3 * i + 2] / sigma;
            for (int j = 0; j < 3; j++) by_turn[3 * i + j] = right[3 * j + i] / sigma;
        }
        product<3, 3, 3>(by_turn, sensor, by_mounting);
    }
};

// ((p₀ − 2 p₁ + p₂) / step² − Rz(γ) f − g) / sigma, its derivative by γ, and the coefficients c of the positions.
struct AccelerationError {
    double residual[3], by_heading[3], c[3];
    AccelerationError(const double* p, double step, double heading, const double* force, double sigma) {
        const double cosine = std::cos(heading), sine = std::sin(heading);
        const double turned[3] = {cosine * force[0] - sine * force[1], sine * force[0] + cosine * force[1], force[2]};
        for (int i = 0; i < 3; i++) residual[i] = ((p[i] - 2 * p[3 + i] + p[6 + i]) / (step * step) - turned[i] + (i == 2 ? 9.81 : 0.0)) / sigma;
        by_heading[0] = turned[1] / sigma, by_heading[1] = -turned[0] / sigma, by_heading[2] = 0.0;
        c[0] = c[2] = 1 / (step * step * sigma), c[1] = -2 * c[0];
    }
};

// terms/orientation.py; charts (S, 3, 3) of mountings, or empty
struct Orientation {
    BodySums& sums;
    Indices<1> bones;
    In<3> mounting;
    In<2> headings;  // (T or 1, S)
    In<4> measured;
    Mask valid;
    double sigma;
    RobustLoss robust;
    In<3> charts;
    int heading_slot = sums.item_block(HEADINGS, 1, bones.data(), bones.size()), mounting_slot = sums.item_block(MOUNTINGS, 3, bones.data(), bones.size());

    void operator()(int64_t t) {
        const int64_t f = sums.frame(t), n = bones.size();
        for (int64_t s = 0; s < n && f < sums.bones().frames; s++) {
            if (!valid(f, s)) continue;
            AttitudeError error(sums.rotation(f, bones(s)), &mounting(s, 0, 0), in_frame(headings, f)[s], &measured(f, s, 0, 0), sigma);
            by_chart<3, 3>(error.by_mounting, charts.size() ? &charts(s, 0, 0) : nullptr);
            Rows rows{3, robust.weight(1.0, error.residual, 3), error.residual};
            rows.add(sums.item_part(HEADINGS, 1, error.by_heading, heading_slot, s));
            rows.add(sums.item_part(MOUNTINGS, 3, error.by_mounting, mounting_slot, s));
            sums.add_twist(t, bones(s), 3, error.by_turn, rows);
        }
    }
};

// Points on bones in successive frames, and the derivatives of their differences by variables other than poses. `shift`
// (n, 3, lengths): derivatives of the points in bone axes by lengths.
struct MovingPoints {
    BodySums& sums;
    Indices<1> bones;
    In<2> p_bone;
    In<3> shift;
    double p[9], arms[9], by_position[9], by_lengths[192], frame_by_lengths[192], by_sole[3];

    void set(int64_t f, int64_t n, int groups) {
        for (int g = 0; g < groups; g++) {
            sums.point(f + g, bones(n), &p_bone(n, 0), p + 3 * g);
            for (int i = 0; i < 3; i++) arms[3 * g + i] = p[3 * g + i] - sums.root(f + g)[i];
        }
    }
    // Derivatives by lengths, by the point's position on its bone, and by the sole's thickness, which lowers it by `sole`.
    void differentiate(int64_t f, int64_t n, int groups, const double* c, double sole) {
        const int width = 3 * sums.lengths();
        std::fill(by_lengths, by_lengths + width, 0.0), std::fill(by_position, by_position + 9, 0.0);
        for (int g = 0; g < groups; g++) {
            const double* R = sums.rotation(f + g, bones(n));
            for (int i = 0; i < 9; i++) by_position[i] += c[g] * R[i];
            if (width == 0) continue;
            sums.by_lengths(f + g, bones(n), &shift(n, 0, 0), frame_by_lengths);
            for (int i = 0; i < width; i++) by_lengths[i] += c[g] * frame_by_lengths[i];
        }
        for (int i = 0; i < 3; i++) by_sole[i] = -sole * by_position[3 * i + 1];
    }
};

// terms/acceleration.py
struct Acceleration {
    MovingPoints points;
    In<2> headings;
    In<3> force;
    Mask valid;
    double step, sigma;
    RobustLoss robust;
    int heading_slot = points.sums.item_block(HEADINGS, 1, points.bones.data(), points.bones.size());
    int position_slot = points.sums.item_block(PLACES, 3, points.bones.data(), points.bones.size());

    void operator()(int64_t t) {
        BodySums& sums = points.sums;
        const int64_t f = sums.frame(t), S = points.bones.size();
        for (int64_t s = 0; s < S && f + 2 < sums.bones().frames; s++) {
            if (!valid(f + 1, s)) continue;
            points.set(f, s, 3);
            const AccelerationError error(points.p, step, in_frame(headings, f)[s], &force(f + 1, s, 0), sigma);
            Rows rows{3, robust.weight(1.0, error.residual, 3), error.residual};
            rows.add(sums.item_part(HEADINGS, 1, error.by_heading, heading_slot, s));
            if (sums.block(PLACES) >= 0 || sums.lengths()) points.differentiate(f, s, 3, error.c, 0.0);
            rows.add(sums.item_part(PLACES, 3, points.by_position, position_slot, s));
            rows.add(sums.part(LENGTHS, sums.lengths(), points.by_lengths));
            sums.add_difference(t, points.bones(s), 3, error.c, points.arms, rows);
        }
    }
};

// terms/foot_contact.py (velocity) and terms/floor_contact.py (height) of points under the sole
struct Contact {
    MovingPoints points;
    In<2> confidence;
    double sole, step, sigma;
    RobustLoss robust;
    FrameMask is_followed;  // (T − 1) frames followed without a pause, for velocities; empty for heights

    void operator()(int64_t t) {
        BodySums& sums = points.sums;
        const int64_t f = sums.frame(t), n = points.bones.size();
        const bool is_height = is_followed.size() == 0;
        if (f + (is_height ? 0 : 1) >= sums.bones().frames || !(is_height || is_followed(f))) return;
        const double root = 1 / ((is_height ? 1.0 : step) * sigma), c[2] = {is_height ? root : -root, root};
        for (int64_t i = 0; i < n; i++) {
            if (confidence(f, i) == 0) continue;
            points.set(f, i, is_height ? 1 : 2);
            const double *p = points.p, *a = points.arms;
            double residual[3], *J = points.by_lengths, *down = points.by_sole;
            for (int r = 0; r < 3; r++) residual[r] = root * (is_height ? p[r] : p[3 + r] - p[r]);
            points.differentiate(f, i, is_height ? 1 : 2, c, sole);
            if (is_height) residual[0] = residual[2], J += 2 * sums.lengths(), down += 2;
            const int m = is_height ? 1 : 3;
            Rows rows{m, robust.weight(confidence(f, i), residual, m), residual};
            rows.add(sums.part(LENGTHS, sums.lengths(), J)), rows.add(sums.part(SOLE, 1, down));
            const double up[6] = {root * a[1], -root * a[0], 0, 0, 0, root};
            if (is_height) sums.add_twist(t, points.bones(i), 6, up, rows);
            else sums.add_difference(t, points.bones(i), 2, c, a, rows);
        }
    }
};

// Camera model of vip_factors/sensors/camera.py: focal lengths, principal point and distortion in OpenCV's order
struct Lens {
    double fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6;

    void project(const double* q, double* pixel, double* J) const {
        const bool in_front = q[2] > 0.1;
        const double z = in_front ? q[2] : 0.1, x = q[0] / z, y = q[1] / z, r2 = x * x + y * y;
        const double bottom = 1 + r2 * (k4 + r2 * (k5 + r2 * k6)), radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / bottom;
        const double slope = (k1 + r2 * (2 * k2 + 3 * k3 * r2) - radial * (k4 + r2 * (2 * k5 + 3 * k6 * r2))) / bottom;
        const double across = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y;
        const double D[4] = {radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x, across, across,
                             radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x};
        pixel[0] = fx * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + cx;
        pixel[1] = fy * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + cy;
        for (int r = 0; r < 2; r++) {
            const double focal = r ? fy : fx, a = D[2 * r], b = D[2 * r + 1];
            J[3 * r] = focal * a / z, J[3 * r + 1] = focal * b / z;
            J[3 * r + 2] = in_front ? -focal * (a * x + b * y) / z : 0.0;
        }
    }
};

// terms/reprojection.py; charts (T or 1, 6, 6) of the camera's poses, or empty
struct Reprojection {
    MovingPoints points;
    In<3> R_camera;
    In<2> p_camera;
    Lens lens;
    In<3> pixels;
    In<2> sigma;
    Mask is_detected;
    In<3> pixels_per_second;
    In<1> seconds_late, since_middle;
    RobustLoss robust;
    int64_t camera;
    In<3> charts;
    Indices<1> items;
    In<2> signs;
    int slot = points.sums.item_block(OFFSETS, 3, points.bones.data(), points.bones.size(), items.data());

    void operator()(int64_t t) {
        BodySums& sums = points.sums;
        const int64_t f = sums.frame(t), n = points.bones.size();
        for (int64_t k = 0; k < n && f < sums.bones().frames; k++) {
            if (!is_detected(f, k)) continue;
            points.set(f, k, 1);
            const double *R = in_frame(R_camera, f), *c = in_frame(p_camera, f), *p = points.p, *a = points.arms, per_sigma = 1 / sigma(f, k);
            double q[3], pixel[2], J[6], by_point[6] = {}, residual[2], by_twist[12], by_pose[12], by_drift[2], by_clock[2], by_zoom[2];
            for (int i = 0; i < 3; i++) q[i] = R[i] * (p[0] - c[0]) + R[3 + i] * (p[1] - c[1]) + R[6 + i] * (p[2] - c[2]);
            lens.project(q, pixel, J), scale(J, 6, per_sigma);
            for (int r = 0; r < 2; r++) {
                by_clock[r] = per_sigma * pixels_per_second(f, k, r), by_drift[r] = since_middle(f) * by_clock[r];
                residual[r] = per_sigma * (pixel[r] - pixels(f, k, r)) + seconds_late(f) * by_clock[r];
                by_zoom[r] = per_sigma * (pixel[r] - (r ? lens.cy : lens.cx));
                const double *by_q = J + 3 * r, *P = by_point + 3 * r;
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++) by_point[3 * r + i] += by_q[j] * R[3 * i + j];
                double* L = by_twist + 6 * r;
                L[0] = a[1] * P[2] - a[2] * P[1], L[1] = a[2] * P[0] - a[0] * P[2], L[2] = a[0] * P[1] - a[1] * P[0];
                double* C = by_pose + 6 * r;
                C[0] = by_q[1] * q[2] - by_q[2] * q[1], C[1] = by_q[2] * q[0] - by_q[0] * q[2], C[2] = by_q[0] * q[1] - by_q[1] * q[0];
                for (int i = 0; i < 3; i++) L[3 + i] = P[i], C[3 + i] = -by_q[i];
            }
            Rows rows{2, robust.weight(1.0, residual, 2), residual};
            by_chart<2, 6>(by_pose, charts.size() ? in_frame(charts, f) : nullptr);
            const double* by_camera[VIEWED] = {by_pose, by_clock, by_drift, by_zoom};
            for (int i = 0; i < VIEWED; i++) rows.add(sums.part_of_camera(camera, i, by_camera[i]));
            double by_lengths[128], by_offset[6];
            if (const int B = sums.lengths()) {
                sums.by_lengths(f, points.bones(k), &points.shift(k, 0, 0), points.frame_by_lengths);
                for (int i = 0; i < 2 * B; i++) {
                    const double *P = by_point + i / B * 3, *L = points.frame_by_lengths + i % B;
                    by_lengths[i] = P[0] * L[0] + P[1] * L[B] + P[2] * L[2 * B];
                }
                rows.add(sums.part(LENGTHS, B, by_lengths));
            }
            if (sums.block(OFFSETS) >= 0) {
                product<2, 3, 3>(by_point, sums.rotation(f, points.bones(k)), by_offset);
                for (int i = 0; i < 6; i++) by_offset[i] *= signs(k, i % 3);
                rows.add(sums.item_part(OFFSETS, 3, by_offset, slot, static_cast<int>(k)));
            }
            sums.add_twist(t, points.bones(k), 6, by_twist, rows);
        }
    }
};

// terms/pose_prior.py
struct PosePrior {
    BodySums& sums;
    In<4> R;  // parent_child
    In<2> P;
    In<1> mean;
    double weight;
    JointSums joints = JointSums(sums, P.data());
    JointJacobians jacobians = {};

    void operator()(int64_t t) {
        const int64_t f = sums.frame(t);
        double x[POSE], D[9 * LIMBS];
        for (int b = 0; b < LIMBS; b++) log(&R(f, b + 1, 0, 0), x + 3 * b), inverse_right_jacobian(x + 3 * b, D + 9 * b);
        for (int i = 0; i < POSE; i++) x[i] -= mean(i);
        joints.set(jacobians, f, 0, D);
        joints.add(t, &jacobians, 1, x, weight, sums.block(POSE_MEAN));
    }
};

// terms/smoothness.py
struct Smoothness {
    BodySums& sums;
    In<4> R;
    In<2> P;
    FrameMask is_followed;
    double weight;
    JointSums joints = JointSums(sums, P.data());
    JointJacobians jacobians[2] = {};

    void operator()(int64_t t) {
        const int64_t f = sums.frame(t);
        if (f + 1 >= sums.bones().frames || !is_followed(f)) return;
        double x[POSE], now[9 * LIMBS], next[9 * LIMBS];
        for (int b = 0; b < LIMBS; b++) {
            const double *A = &R(f, b + 1, 0, 0), *B = &R(f + 1, b + 1, 0, 0);
            double back[9], turn[9];
            for (int i = 0; i < 9; i++) back[i] = A[i % 3 * 3 + i / 3];
            product<3, 3, 3>(back, B, turn), log(turn, x + 3 * b), inverse_right_jacobian(x + 3 * b, next + 9 * b);
            for (int i = 0; i < 9; i++) now[9 * b + i] = -next[9 * b + i % 3 * 3 + i / 3];
        }
        joints.set(jacobians[0], f, 0, now), joints.set(jacobians[1], f + 1, 1, next);
        joints.add(t, jacobians, 2, x, weight, -1);
    }
};

// terms/joint_limit.py
struct JointLimit {
    BodySums& sums;
    In<4> R;
    In<1> lower, upper;
    double sigma;
    bool per_axis;
    RobustLoss robust;

    void operator()(int64_t t) {
        const int64_t f = sums.frame(t);
        for (int b = 0; b < LIMBS; b++) {
            double x[3], outside[3], D[9];
            log(&R(f, b + 1, 0, 0), x);
            for (int i = 0; i < 3; i++) outside[i] = (std::min(x[i] - lower(3 * b + i), 0.0) + std::max(x[i] - upper(3 * b + i), 0.0)) / sigma;
            if (outside[0] == 0 && outside[1] == 0 && outside[2] == 0) continue;
            inverse_right_jacobian(x, D), scale(D, 9, 1 / sigma);
            by_chart<3, 3>(D, sums.bones().turns == nullptr ? nullptr : sums.bones().turns + 9 * (JOINTS * f + b + 1));
            for (int i = 0; i < 3; i++) {
                if (outside[i] == 0) continue;
                Rows rows{1, robust.weight(1.0, per_axis ? outside + i : outside, per_axis ? 1 : 3), outside + i};
                rows.add({sums.column(0, 3 + 3 * b), 3, D + 3 * i});
                sums.add_direct(t, rows);
            }
        }
    }
};

// terms/hinge.py; for item_block row the hinge, its joint, the axis (rows, 3) and its derivatives by the tilts (rows, 3, 2)
struct Hinge {
    BodySums& sums;
    In<4> R;
    Indices<1> hinges, joints;
    In<2> square, axes;
    In<3> by_tilts;
    In<1> offsets, whitening;
    RobustLoss robust;

    void operator()(int64_t t) {
        const int64_t f = sums.frame(t), n = hinges.size(), tilts = 2 * (hinges(n - 1) + 1), start = sums.block(HINGES);
        double residual[16], along[48];
        for (int64_t r = 0; r < n; r++) {
            product<3, 3, 1>(&R(f, joints(r), 0, 0), &square(r, 0), along + 3 * r);
            residual[r] = -offsets(r);
            for (int i = 0; i < 3; i++) residual[r] += axes(r, i) * along[3 * r + i];
            residual[r] *= whitening(r);
        }
        const double weight = robust.weight(1.0, residual, static_cast<int>(n));
        for (int64_t r = 0; r < n; r++) {
            const double *d = &square(r, 0), w = whitening(r), minus = -w;
            double a[3], by_tilt[2] = {};
            product<1, 3, 3>(&axes(r, 0), &R(f, joints(r), 0, 0), a);
            double by_joint[3] = {w * (d[1] * a[2] - d[2] * a[1]), w * (d[2] * a[0] - d[0] * a[2]), w * (d[0] * a[1] - d[1] * a[0])};
            by_chart<1, 3>(by_joint, sums.bones().turns == nullptr ? nullptr : sums.bones().turns + 9 * (JOINTS * f + joints(r)));
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 2; j++) by_tilt[j] += w * along[3 * r + i] * by_tilts(r, i, j);
            Rows rows{1, weight, residual + r};
            rows.add({sums.column(0, 3 * joints(r)), 3, by_joint});
            if (start >= 0) rows.add({start + 2 * hinges(r), 2, by_tilt}), rows.add({start + tilts + r, 1, &minus});
            sums.add_direct(t, rows);
        }
    }
};

// Poses of a camera (T or 1, …), and their charts (T or 1, 6, 6), or empty.
struct Camera {
    BodySums& sums;
    In<3> R;
    In<2> p;
    In<3> charts;

    void add(Rows& rows, int64_t f, int ahead, int m, double* J) const {  // J (m, 6) by the pose
        if (sums.pose(0) < 0) return;
        const double* chart = charts.size() ? in_frame(charts, f + ahead) : nullptr;
        for (int r = 0; r < m; r++) by_chart<1, 6>(J + 6 * r, chart);
        rows.add({sums.pose(ahead), 6, J});
    }
};

// terms/camera_orientation.py; chart (1, 3, 3) of the mounting, or empty
struct CameraOrientation {
    Camera camera;
    In<2> mounting;
    double heading;
    In<4> measured;
    Mask valid;
    double sigma;
    RobustLoss robust;
    In<3> chart;

    void operator()(int64_t t) const {
        const BodySums& sums = camera.sums;
        const int64_t f = sums.frame(t);
        if (!valid(f, 0)) return;
        AttitudeError error(in_frame(camera.R, f), mounting.data(), heading, &measured(f, 0, 0, 0), sigma);
        double turned[9], by_pose[18] = {};
        product<3, 3, 3>(error.by_turn, in_frame(camera.R, f), turned);
        for (int i = 0; i < 9; i++) by_pose[i / 3 * 6 + i % 3] = turned[i];
        by_chart<3, 3>(error.by_mounting, chart.size() ? chart.data() : nullptr);
        Rows rows{3, robust.weight(1.0, error.residual, 3), error.residual};
        camera.add(rows, f, 0, 3, by_pose);
        rows.add({sums.block(HEADING), 1, error.by_heading}), rows.add({sums.block(CAMERA_MOUNTING), 3, error.by_mounting});
        sums.add_direct(t, rows);
    }
};

// terms/camera_acceleration.py
struct CameraAcceleration {
    Camera camera;
    In<1> p_camera_imu;
    double heading;
    In<3> force;
    Mask valid;
    double step, sigma;
    RobustLoss robust;

    void operator()(int64_t t) const {
        const BodySums& sums = camera.sums;
        const int64_t f = sums.frame(t);
        if (f + 2 >= sums.bones().frames || !valid(f + 1, 0)) return;
        double p[9], J[3][18], cross[9], turned[9];
        hat(p_camera_imu.data(), cross);
        for (int g = 0; g < 3; g++) {
            product<3, 3, 1>(in_frame(camera.R, f + g), p_camera_imu.data(), p + 3 * g);
            for (int i = 0; i < 3; i++) p[3 * g + i] += in_frame(camera.p, f + g)[i];
        }
        const AccelerationError error(p, step, heading, &force(f + 1, 0, 0), sigma);
        Rows rows{3, robust.weight(1.0, error.residual, 3), error.residual};
        for (int g = 0; g < 3; g++) {
            const double* R = in_frame(camera.R, f + g);
            product<3, 3, 3>(R, cross, turned);
            for (int i = 0; i < 9; i++) J[g][i / 3 * 6 + i % 3] = -error.c[g] * turned[i], J[g][i / 3 * 6 + 3 + i % 3] = error.c[g] * R[i];
            camera.add(rows, f, g, 3, J[g]);
        }
        rows.add({sums.block(HEADING), 1, error.by_heading});
        sums.add_direct(t, rows);
    }
};

// terms/camera_velocity.py
struct CameraVelocity {
    Camera camera;
    double step;
    In<1> sigmas;
    RobustLoss robust;

    void operator()(int64_t t) const {
        const BodySums& sums = camera.sums;
        const int64_t f = sums.frame(t);
        if (f + 1 >= sums.bones().frames) return;
        const double *A = in_frame(camera.R, f), *B = in_frame(camera.R, f + 1), *p = in_frame(camera.p, f), *q = in_frame(camera.p, f + 1);
        const double shift_world[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
        double back[9], turned[9], residual[6], right[9], cross[9], now[36] = {}, next[36] = {};
        for (int i = 0; i < 9; i++) back[i] = A[i % 3 * 3 + i / 3];
        product<3, 3, 3>(back, B, turned), log(turned, residual), product<3, 3, 1>(back, shift_world, residual + 3);
        inverse_right_jacobian(residual, right), hat(residual + 3, cross);
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) {
                const double turn = 1 / (step * sigmas(r)), shift = 1 / (step * sigmas(3 + r));
                next[6 * r + c] = turn * right[3 * r + c], now[6 * r + c] = -turn * right[3 * c + r];
                now[18 + 6 * r + c] = shift * cross[3 * r + c], now[21 + 6 * r + c] = r == c ? -shift : 0.0;
                next[21 + 6 * r + c] = shift * turned[3 * r + c];
            }
        for (int r = 0; r < 6; r++) residual[r] /= step * sigmas(r);
        Rows rows{6, robust.weight(1.0, residual, 6), residual};
        camera.add(rows, f, 0, 6, now), camera.add(rows, f, 1, 6, next);
        sums.add_direct(t, rows);
    }
};

}  // namespace vip
