// vip_factors._kernels: compiled versions of functions in which NumPy's call overhead exceeds the arithmetic.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string_view.h>

#include "cameras.hpp"
#include "elimination.hpp"
#include "links.hpp"
#include "rotations.hpp"
#include "slices.hpp"
#include "terms.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using vip::ANY, vip::BodySums, vip::FrameMask, vip::In, vip::Indices, vip::Mask, vip::Out, vip::Target;
using vip::expect, vip::expect_shape, vip::expect_within, vip::has_shape;
using Flags = nb::ndarray<bool, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Applies a function of SO(3) or SE(3) to a stack (n, …).
template <int in, int out, void f(const double*, double*)> static void over_stack(In<2> from, Out<2> to) {
    expect(from.shape(1) == in && to.shape(1) == out && from.shape(0) == to.shape(0));
    for (size_t i = 0; i < from.shape(0); i++) f(from.data() + in * i, to.data() + out * i);
}

static void forward_kinematics(In<4> R, In<2> offsets, In<2> root, Indices<1> parents, Out<4> R_world, Out<3> p_world) {
    const size_t J = parents.shape(0);
    const auto T = static_cast<int64_t>(R.shape(0)), joints = static_cast<int64_t>(J);
    vip::expect_parents(parents);
    expect_shape(R, {T, joints, 3, 3}), expect_shape(offsets, {joints, 3}), expect_shape(root, {T, 3});
    expect_shape(R_world, {T, joints, 3, 3}), expect_shape(p_world, {T, joints, 3});
    for (size_t t = 0; t < R.shape(0); t++) {
        const double* R_parent_child = R.data() + 9 * J * t;
        double *R_frame = R_world.data() + 9 * J * t, *p_frame = p_world.data() + 3 * J * t;
        std::copy(R_parent_child, R_parent_child + 9, R_frame);
        std::copy(&root(t, 0), &root(t, 0) + 3, p_frame);
        for (size_t j = 1; j < J; j++) {
            const size_t parent = static_cast<size_t>(parents(j));
            vip::product<3, 3, 3>(R_frame + 9 * parent, R_parent_child + 9 * j, R_frame + 9 * j);
            vip::product<3, 3, 1>(R_frame + 9 * parent, &offsets(j, 0), p_frame + 3 * j);
            for (int c = 0; c < 3; c++) p_frame[3 * j + c] += p_frame[3 * parent + c];
        }
    }
}

static void points(In<4> R_world, In<3> p_world, Indices<1> bones, In<2> offsets, Out<3> p_points) {
    const size_t T = R_world.shape(0), J = R_world.shape(1), n = bones.shape(0);
    const auto frames = static_cast<int64_t>(T), joints = static_cast<int64_t>(J), count = static_cast<int64_t>(n);
    expect_shape(R_world, {frames, joints, 3, 3}), expect_shape(p_world, {frames, joints, 3});
    expect_shape(offsets, {count, 3}), expect_shape(p_points, {frames, count, 3}), expect_within(bones, 0, joints);
    for (size_t i = 0; i < n; i++) {
        const auto bone = static_cast<size_t>(bones(i));
        for (size_t t = 0; t < T; t++) {
            vip::product<3, 3, 1>(R_world.data() + 9 * (J * t + bone), &offsets(i, 0), &p_points(t, i, 0));
            for (size_t c = 0; c < 3; c++) p_points(t, i, c) += p_world(t, bone, c);
        }
    }
}

static void screws(In<4> R_world, In<3> p_world, Out<4> out) {
    const size_t J = R_world.shape(1);
    const auto frames = static_cast<int64_t>(R_world.shape(0)), joints = static_cast<int64_t>(J);
    expect(joints > 0), expect_shape(R_world, {frames, joints, 3, 3}), expect_shape(p_world, {frames, joints, 3});
    expect_shape(out, {frames, joints + 1, 6, 3});
    std::fill(out.data(), out.data() + out.size(), 0.0);
    for (size_t t = 0; t < R_world.shape(0); t++) {
        const double *R = R_world.data() + 9 * J * t, *p = p_world.data() + 3 * J * t;
        double* into = out.data() + 18 * (J + 1) * t;
        for (size_t j = 0; j < J; j++) {
            const double arm[3] = {p[3 * j] - p[0], p[3 * j + 1] - p[1], p[3 * j + 2] - p[2]};
            double cross[9];
            vip::hat(arm, cross);
            std::copy(R + 9 * j, R + 9 * j + 9, into + 18 * j);
            vip::product<3, 3, 3>(cross, R + 9 * j, into + 18 * j + 9);
        }
        for (int c = 0; c < 3; c++) into[18 * J + 9 + 4 * c] = 1.0;
    }
}

// Points (P, K, 3), image points (P, K, 2), weights and precisions (P, K); moves camera poses (P, 3, 3) and (P, 3) by `steps`
// steps in place and writes their costs (P).
static void follow_cameras(In<3> points, In<3> image, In<2> weight, In<2> precision, int64_t steps, Out<3> R, Out<2> t, Out<1> cost) {
    const auto P = static_cast<int64_t>(points.shape(0)), K = static_cast<int64_t>(points.shape(1));
    expect_shape(points, {P, K, 3}), expect_shape(image, {P, K, 2}), expect_shape(weight, {P, K}), expect_shape(precision, {P, K});
    expect_shape(R, {P, 3, 3}), expect_shape(t, {P, 3}), expect_shape(cost, {P});
    for (int64_t i = 0; i < P; i++) {
        const vip::Observation observation{K, points.data() + i * K * 3, image.data() + i * K * 2,
                                           weight.data() + i * K, precision.data() + i * K};
        cost(i) = vip::follow_camera(observation, steps, R.data() + i * 9, t.data() + i * 3);
    }
}

// For both ends of a link: quaternions of headings (K, 4), mountings (K, M, 4) and orientations (T, 4). For the bend: mean and
// limits (3, 3), whitening (3, 3). Writes the costs (K * M, K * M).
static void bend_cost(In<2> headings_parent, In<3> mountings_parent, In<2> orientations_parent, In<2> headings_child,
                      In<3> mountings_child, In<2> orientations_child, In<2> limits, In<2> whitening, Out<2> cost) {
    const auto end = [](const In<2>& heading, const In<3>& mounting, const In<2>& orientation) {
        expect_shape(heading, {static_cast<int64_t>(mounting.shape(0)), 4}), expect_shape(mounting, {ANY, ANY, 4}), expect_shape(orientation, {ANY, 4});
        return vip::LinkEnd{heading.data(), mounting.data(), orientation.data(), static_cast<int64_t>(mounting.shape(0)),
                            static_cast<int64_t>(mounting.shape(1))};
    };
    const vip::LinkEnd parent = end(headings_parent, mountings_parent, orientations_parent);
    const vip::LinkEnd child = end(headings_child, mountings_child, orientations_child);
    expect(orientations_parent.shape(0) == orientations_child.shape(0));
    expect_shape(limits, {3, 3}), expect_shape(whitening, {3, 3}), expect_shape(cost, {parent.size(), child.size()});
    vip::bend_cost(parent, child, static_cast<int64_t>(orientations_parent.shape(0)), limits.data(), whitening.data(), cost.data());
}

// Target of slices (T, n, n) and (T, n).
static void target_of_slices(Target* target, Out<3> hessian, Out<2> gradient) {
    const auto T = static_cast<int64_t>(hessian.shape(0)), n = static_cast<int64_t>(hessian.shape(1));
    expect_shape(hessian, {T, n, n}), expect_shape(gradient, {T, n});
    new (target) Target{std::vector<double*>(n), std::vector<double*>(n), std::vector<int64_t>(n, n * n),
                        std::vector<int64_t>(n, n), std::vector<int>(n, 0), {std::vector<int64_t>(n)}, T, std::vector<int64_t>(n, 0)};
    for (int64_t c = 0; c < n; c++) {
        target->rows[c] = hessian.data() + c * n, target->gradients[c] = gradient.data() + c;
        target->orders[0][c] = c;
    }
}

// Target of a stretch: rows (frames + 2, w, m) with the columns of a frame, of the next two if frames are tied, and of shared
// variables; (s, s) and (s) of the shared variables.
static void target_of_stretch(Target* target, Out<3> rows, Out<2> gradient, Out<2> shared, Out<1> shared_gradient) {
    const auto T = static_cast<int64_t>(rows.shape(0)), w = static_cast<int64_t>(rows.shape(1)), m = static_cast<int64_t>(rows.shape(2));
    const auto s = static_cast<int64_t>(shared.shape(0)), n = vip::FRAMES * w + s;
    expect(T >= vip::REACH && (m == n || m == w + s)), expect_shape(gradient, {T, w}), expect_shape(shared, {s, s}), expect_shape(shared_gradient, {s});
    Target stretch{std::vector<double*>(n), std::vector<double*>(n), std::vector<int64_t>(n, 0), std::vector<int64_t>(n, 0),
                 std::vector<int>(n, vip::FRAMES), std::vector<std::vector<int64_t>>(vip::FRAMES + 1, std::vector<int64_t>(n, -1)),
                 T - vip::REACH, std::vector<int64_t>(n, 0)};
    for (int64_t i = 0; i < vip::FRAMES; i++) {
        for (int64_t c = 0; c < w; c++) {
            stretch.rows[i * w + c] = rows.data() + (i * w + c) * m, stretch.row_step[i * w + c] = w * m;
            stretch.gradients[i * w + c] = gradient.data() + i * w + c, stretch.gradient_step[i * w + c] = w;
            stretch.kind[i * w + c] = static_cast<int>(i), stretch.ahead[i * w + c] = i;
        }
        for (int64_t c = i * w; c < (m == n ? vip::FRAMES : i + 1) * w; c++) stretch.orders[i][c] = c - i * w;
        for (int64_t c = 0; c < s; c++) stretch.orders[i][vip::FRAMES * w + c] = m - s + c;
    }
    for (int64_t c = 0; c < s; c++) {
        stretch.rows[n - s + c] = shared.data() + c * s, stretch.gradients[n - s + c] = shared_gradient.data() + c;
        stretch.orders[vip::FRAMES][n - s + c] = c;
    }
    new (target) Target(std::move(stretch));
}

// Sums of a body from frame `begin` on; see BodySums.
static void make_body_sums(BodySums* self, const Target& target, int64_t begin, In<4> R, In<3> p, In<4> turns, int64_t first,
                    int64_t frame, Indices<1> parents, Indices<1> columns, In<3> directions, Indices<2> cameras) {
    const auto T = static_cast<int64_t>(R.shape(0));
    vip::expect_parents(parents);
    expect_shape(parents, {vip::JOINTS}), expect_shape(columns, {vip::BLOCKS}), expect_within(columns, INT64_MIN, target.width());
    if (R.size() == 0 && first < 0) expect_shape(R, {T, 0, 3, 3}), expect_shape(p, {T, 0, 3});  // cameras only
    else expect_shape(R, {T, vip::JOINTS, 3, 3}), expect_shape(p, {T, vip::JOINTS, 3});
    expect(turns.size() == 0 || (turns.shape(0) >= R.shape(0) && has_shape(turns, {ANY, vip::JOINTS, 3, 3})));
    expect(directions.size() == 0 || (has_shape(directions, {vip::JOINTS, 3, ANY}) && directions.shape(2) <= 60));
    expect(begin >= 0 && begin + target.frames <= T && frame >= 0);
    expect_shape(cameras, {ANY, vip::VIEWED});
    for (size_t i = 0; i < cameras.size(); i++) expect(cameras.data()[i] < target.width());
    const vip::Bones bones{R.data(), p.data(), turns.size() ? turns.data() : nullptr, static_cast<int64_t>(R.shape(0))};
    new (self) BodySums(target, begin, bones, first, frame, parents.data(), columns.data(),
                        directions.size() ? directions.data() : nullptr, static_cast<int>(directions.shape(2)),
                        cameras.data(), cameras.shape(0));
    self->add_term([R, p, turns, directions](int64_t) {});  // keeps the arrays alive
}

static vip::RobustLoss robust_loss(std::string_view loss, double k, double share) {
    expect(!loss.empty(), "a loss needs a name");
    return {loss[0], k, share};
}

static vip::MovingPoints moving_points(BodySums& sums, Indices<1> bones, In<2> p_bone, In<3> shift) {
    const auto n = static_cast<int64_t>(bones.size());
    expect_shape(p_bone, {n, 3}), expect_within(bones, 0, vip::JOINTS);
    if (sums.lengths() > 0) expect_shape(shift, {n, 3, sums.lengths()});
    sums.expect_block(vip::LENGTHS, sums.lengths());
    return {sums, bones, p_bone, shift, {}, {}, {}, {}, {}, {}};
}

static bool has_all_frames(const BodySums& sums, size_t frames) { return static_cast<int64_t>(frames) == sums.bones().frames; }

// The array has one element for every frame, or a constant one.
template <class Array> static void expect_all_or_constant(const BodySums& sums, const Array& array) {
    expect(array.shape(0) == 1 || has_all_frames(sums, array.shape(0)));
}

// Joint rotations (T, 24, 3, 3) of a body that is not constant.
static void expect_joints(const BodySums& sums, const In<4>& R) {
    expect(sums.moves(), "the body is constant"), expect_shape(R, {sums.bones().frames, vip::JOINTS, 3, 3});
}

static void add_orientation(BodySums& sums, Indices<1> bones, In<3> mounting, In<2> headings, In<4> measured, Mask valid,
                            double sigma, std::string_view loss, double k, double share, In<3> charts) {
    const auto n = static_cast<int64_t>(bones.size()), T = sums.bones().frames;
    expect_shape(mounting, {n, 3, 3}), expect_shape(headings, {ANY, n}), expect_all_or_constant(sums, headings);
    expect_shape(measured, {T, n, 3, 3}), expect_shape(valid, {T, n}), expect_within(bones, 0, vip::JOINTS);
    expect(charts.size() == 0 || has_shape(charts, {n, 3, 3}));
    sums.expect_block(vip::HEADINGS, n), sums.expect_block(vip::MOUNTINGS, 3 * n);
    sums.add_term(vip::Orientation{sums, bones, mounting, headings, measured, valid, sigma, robust_loss(loss, k, share), charts});
}

static void add_acceleration(BodySums& sums, Indices<1> bones, In<2> p_bone, In<3> shift, In<2> headings, In<3> force, Mask valid,
                             double step, double sigma, std::string_view loss, double k, double share) {
    const auto n = static_cast<int64_t>(bones.size()), T = sums.bones().frames;
    expect_shape(headings, {ANY, n}), expect_all_or_constant(sums, headings), expect_shape(force, {T, n, 3}), expect_shape(valid, {T, n});
    sums.expect_block(vip::HEADINGS, n), sums.expect_block(vip::PLACES, 3 * n);
    sums.add_term(vip::Acceleration{moving_points(sums, bones, p_bone, shift), headings, force, valid, step, sigma, robust_loss(loss, k, share)});
}

static void add_contact(BodySums& sums, Indices<1> bones, In<2> p_bone, In<3> shift, In<2> confidence, double sole, double step,
                        double sigma, std::string_view loss, double k, double share, FrameMask is_followed) {
    expect_shape(confidence, {sums.bones().frames, static_cast<int64_t>(bones.size())});
    expect(is_followed.size() == 0 || has_all_frames(sums, is_followed.size() + 1));
    sums.expect_block(vip::SOLE, 1);
    sums.add_term(vip::Contact{moving_points(sums, bones, p_bone, shift), confidence, sole, step, sigma, robust_loss(loss, k, share), is_followed});
}

static void add_reprojection(BodySums& sums, Indices<1> bones, In<2> p_bone, In<3> shift, In<3> R_camera, In<2> p_camera,
                             In<1> lens, In<3> pixels, In<2> sigma, Mask is_detected, In<3> pixels_per_second, In<1> seconds_late, In<1> since_middle,
                             std::string_view loss, double k, double share, int64_t camera, In<3> charts, Indices<1> items,
                             In<2> signs) {
    const auto n = static_cast<int64_t>(bones.size()), T = sums.bones().frames;
    expect_shape(R_camera, {ANY, 3, 3}), expect_all_or_constant(sums, R_camera), expect_shape(p_camera, {ANY, 3}), expect_all_or_constant(sums, p_camera);
    expect_shape(lens, {12}), expect_shape(pixels, {T, n, 2}), expect_shape(sigma, {T, n}), expect_shape(is_detected, {T, n});
    expect_shape(pixels_per_second, {T, n, 2}), expect_shape(seconds_late, {T}), expect_shape(since_middle, {T}), expect_shape(items, {n}), expect_shape(signs, {n, 3});
    if (charts.size()) expect_shape(charts, {ANY, 6, 6}), expect_all_or_constant(sums, charts);
    int64_t offsets = 0;
    expect_within(items, INT64_MIN, 1 << 20);
    for (int64_t i = 0; i < n; i++) offsets = std::max(offsets, 3 * (items(i) + 1));
    sums.expect_block(vip::OFFSETS, offsets);
    sums.expect_camera(camera);
    vip::Lens model;
    std::copy(lens.data(), lens.data() + 12, reinterpret_cast<double*>(&model));
    sums.add_term(vip::Reprojection{moving_points(sums, bones, p_bone, shift), R_camera, p_camera, model, pixels, sigma, is_detected, pixels_per_second,
                                 seconds_late, since_middle, robust_loss(loss, k, share), camera, charts, items, signs});
}

static void add_pose_prior(BodySums& sums, In<4> R, In<2> information, In<1> mean, double weight) {
    expect_joints(sums, R), expect_shape(information, {vip::POSE, vip::POSE}), expect_shape(mean, {vip::POSE});
    sums.expect_block(vip::POSE_MEAN, vip::POSE);
    sums.add_term(vip::PosePrior{sums, R, information, mean, weight});
}

static void add_smoothness(BodySums& sums, In<4> R, In<2> information, FrameMask is_followed, double weight) {
    expect_joints(sums, R), expect_shape(information, {vip::POSE, vip::POSE}), expect(has_all_frames(sums, is_followed.size() + 1));
    sums.add_term(vip::Smoothness{sums, R, information, is_followed, weight});
}

static void add_joint_limit(BodySums& sums, In<4> R, In<1> lower, In<1> upper, double sigma, bool per_axis, std::string_view loss,
                            double k, double share) {
    expect_joints(sums, R), expect_shape(lower, {vip::POSE}), expect_shape(upper, {vip::POSE});
    sums.add_term(vip::JointLimit{sums, R, lower, upper, sigma, per_axis, robust_loss(loss, k, share)});
}

static void add_hinge(BodySums& sums, In<4> R, Indices<1> hinges, Indices<1> joints, In<2> square, In<2> axes, In<3> by_tilts,
                      In<1> offsets, In<1> whitening, std::string_view loss, double k, double share) {
    const auto n = static_cast<int64_t>(hinges.size());
    expect(n > 0 && n <= 16), expect_joints(sums, R), expect_shape(joints, {n}), expect_within(joints, 1, vip::JOINTS);
    expect_within(hinges, 0, n), expect_within(hinges, 0, hinges(n - 1) + 1);
    expect_shape(square, {n, 3}), expect_shape(axes, {n, 3}), expect_shape(by_tilts, {n, 3, 2});
    expect_shape(offsets, {n}), expect_shape(whitening, {n});
    sums.expect_block(vip::HINGES, 2 * (hinges(n - 1) + 1) + n);
    sums.add_term(vip::Hinge{sums, R, hinges, joints, square, axes, by_tilts, offsets, whitening, robust_loss(loss, k, share)});
}

static vip::Camera camera(BodySums& sums, In<3> R, In<2> p, In<3> charts, int frames) {
    expect_shape(R, {ANY, 3, 3}), expect_all_or_constant(sums, R), expect_shape(p, {ANY, 3}), expect_all_or_constant(sums, p);
    if (charts.size()) expect_shape(charts, {ANY, 6, 6}), expect_all_or_constant(sums, charts);
    sums.expect_poses(frames);
    return {sums, R, p, charts};
}

static void add_camera_orientation(BodySums& sums, In<3> R, In<2> p, In<3> charts, In<2> mounting, double heading, In<4> measured,
                                   Mask valid, double sigma, std::string_view loss, double k, double share, In<3> chart) {
    const int64_t T = sums.bones().frames;
    expect_shape(mounting, {3, 3}), expect_shape(measured, {T, 1, 3, 3}), expect_shape(valid, {T, 1});
    expect(chart.size() == 0 || has_shape(chart, {1, 3, 3}));
    sums.expect_block(vip::HEADING, 1), sums.expect_block(vip::CAMERA_MOUNTING, 3);
    sums.add_term(vip::CameraOrientation{camera(sums, R, p, charts, 1), mounting, heading, measured, valid, sigma, robust_loss(loss, k, share), chart});
}

static void add_camera_acceleration(BodySums& sums, In<3> R, In<2> p, In<3> charts, In<1> p_camera_imu, double heading, In<3> force,
                                    Mask valid, double step, double sigma, std::string_view loss, double k, double share) {
    const int64_t T = sums.bones().frames;
    expect_shape(p_camera_imu, {3}), expect_shape(force, {T, 1, 3}), expect_shape(valid, {T, 1});
    sums.expect_block(vip::HEADING, 1);
    sums.add_term(vip::CameraAcceleration{camera(sums, R, p, charts, vip::FRAMES), p_camera_imu, heading, force, valid, step, sigma, robust_loss(loss, k, share)});
}

static void add_camera_velocity(BodySums& sums, In<3> R, In<2> p, In<3> charts, double step, In<1> sigmas, std::string_view loss,
                                double k, double share) {
    expect_shape(sigmas, {6});
    sums.add_term(vip::CameraVelocity{camera(sums, R, p, charts, 2), step, sigmas, robust_loss(loss, k, share)});
}

static void expand(BodySums& sums) {
    nb::gil_scoped_release released;  // several stretches are summed in parallel
    sums.expand();
}

static vip::Blas blas;

static void expect_blas() { expect(blas.dpotrf != nullptr, "call use_blas first"); }

// Loads SciPy's functions from the C API of its Cython modules.
static void use_blas(nb::dict functions) {
    auto load = [&](const char* name, auto& into) {
        nb::object capsule = functions[name];
        into = reinterpret_cast<std::decay_t<decltype(into)>>(
            PyCapsule_GetPointer(capsule.ptr(), PyCapsule_GetName(capsule.ptr())));
        if (into == nullptr) throw nb::python_error();
    };
    load("dpotrf", blas.dpotrf), load("dtrsm", blas.dtrsm), load("dsyrk", blas.dsyrk);
    load("dtrsv", blas.dtrsv), load("dgemv", blas.dgemv), load("dgemm", blas.dgemm);
}

// Eliminates the variables first … first + width − 1, after the ones before them.
static bool eliminate(Out<2> information, Out<1> vector, int first, int width) {
    const auto n = static_cast<int>(vector.shape(0));
    expect_blas(), expect_shape(information, {n, n});
    expect(first >= 0 && first <= n && width >= 0 && width <= n - first);
    double* rows = information.data() + (n + 1) * static_cast<int64_t>(first);
    return vip::eliminate(blas, rows, vector.data() + first, n, n - first, width, rows + (n + 1) * static_cast<int64_t>(width), n);
}

// Copies the variables `order` of a quadratic, in that order.
static void reorder(In<2> information, In<1> vector, Indices<1> order, Out<2> into, Out<1> into_vector) {
    const size_t n = vector.shape(0), k = order.shape(0);
    const auto variables = static_cast<int64_t>(n), selected = static_cast<int64_t>(k);
    expect_shape(information, {variables, variables}), expect_within(order, 0, variables);
    expect_shape(into, {selected, selected}), expect_shape(into_vector, {selected});
    for (size_t i = 0; i < k; i++) {
        const int64_t variable = order(i);
        into_vector(i) = vector(variable);
        double* row = &into(i, 0);
        for (size_t j = i, end; j < k; j = end) {  // runs of adjacent columns
            for (end = j + 1; end < k && order(end) == order(end - 1) + 1; end++) {}
            const double* from = information.data() + order(j) * n + variable;  // down a column, or along a row
            if (order(j) >= variable) std::copy(&information(variable, order(j)), &information(variable, order(j)) + (end - j), row + j);
            else
                for (size_t l = j; l < end; l++, from += n) row[l] = *from;
        }
    }
}

// Solves R x + S y = d for x, given y = `later`. `rows` (w, n), which may be strided, holds R and S; `values` holds d and becomes x.
static void substitute(nb::ndarray<double, nb::ndim<2>, nb::device::cpu> rows, In<1> later, Out<1> values) {
    const auto w = static_cast<int64_t>(rows.shape(0)), n = static_cast<int64_t>(rows.shape(1));
    expect_blas(), expect(w <= n), expect_shape(later, {n - w}), expect_shape(values, {w});
    expect(w == 0 || (rows.stride(1) == 1 && (w == 1 || rows.stride(0) >= n)), "elements of a row must be adjacent");
    std::vector<double> y(later.data(), later.data() + (n - w));
    vip::substitute(blas, rows.data(), static_cast<int>(rows.stride(0)), static_cast<int>(n), static_cast<int>(w), y.data(), values.data());
}

static bool is_ascending(Indices<1> places, int64_t end) {
    for (size_t i = 0; i < places.size(); i++)
        if (places(i) < (i == 0 ? 0 : places(i - 1) + 1) || places(i) >= end) return false;
    return true;
}

// Stretch whose conditionals (T, eliminated, n) have `extra` further columns in each frame and s border columns.
static vip::Stretch make_stretch(Indices<1> far, bool tied, Out<3> conditionals, int64_t extra, int64_t s) {
    const auto T = static_cast<int64_t>(conditionals.shape(0)), eliminated = static_cast<int64_t>(conditionals.shape(1));
    vip::Stretch stretch{nullptr, nullptr, nullptr, nullptr, far.data(), T, static_cast<int64_t>(far.size()), eliminated + extra, 0,
                         static_cast<int>(eliminated), static_cast<int>(s), tied};
    expect_blas(), expect(is_ascending(far, eliminated), "columns must ascend"), expect_shape(conditionals, {T, eliminated, eliminated + stretch.rest()});
    expect(extra >= 0 && extra * T <= s);
    return stretch;
}

static bool eliminate_stretch(In<3> rows, In<2> gradient, In<2> shared, In<1> shared_gradient, Indices<1> far, bool tied,
                              int64_t s, In<1> damping, Out<2> information, Out<1> vector, Out<3> conditionals, Out<2> d) {
    const auto shared_width = static_cast<int64_t>(shared.shape(0)), eliminated = static_cast<int64_t>(conditionals.shape(1));
    vip::Stretch stretch = make_stretch(far, tied, conditionals, static_cast<int64_t>(rows.shape(1)) - eliminated, s);
    stretch.shared_width = shared_width, expect(shared_width + stretch.frames * (stretch.w - eliminated) <= s);
    expect_shape(rows, {stretch.frames + vip::REACH, stretch.w, stretch.width()}), expect_shape(gradient, {stretch.frames + vip::REACH, stretch.w});
    expect_shape(shared, {shared_width, shared_width}), expect_shape(shared_gradient, {shared_width});
    expect_shape(damping, {eliminated}), expect_shape(d, {stretch.frames, eliminated});
    expect_shape(information, {stretch.rest(), stretch.rest()}), expect_shape(vector, {stretch.rest()});
    stretch.rows = rows.data(), stretch.gradient = gradient.data(), stretch.shared = shared.data(), stretch.shared_gradient = shared_gradient.data();
    return vip::eliminate_stretch(blas, stretch, damping.data(), information.data(), vector.data(), conditionals.data(), d.data());
}

// `steps` (T, eliminated) holds d and becomes the solution; `behind` (2, eliminated) holds the steps of the next two frames.
static void substitute_stretch(Out<3> conditionals, Indices<1> far, bool tied, int64_t extra, In<2> behind, In<1> border, Out<2> steps) {
    const vip::Stretch stretch = make_stretch(far, tied, conditionals, extra, static_cast<int64_t>(border.shape(0)));
    expect_shape(behind, {vip::REACH, stretch.eliminated}), expect_shape(steps, {stretch.frames, stretch.eliminated});
    vip::substitute_stretch(blas, stretch, conditionals.data(), behind.data(), border.data(), steps.data());
}

// Copies ascending columns of a slice (N, N) as a quadratic in coordinates instead of steps from `value`, and clears the part
// of the slice that was used.
static void slice_in_coordinates(Out<2> hessian, Out<1> gradient, In<1> value, Indices<1> columns, Out<2> information, Out<1> vector) {
    const auto N = static_cast<int64_t>(hessian.shape(0)), n = static_cast<int64_t>(value.shape(0));
    expect_shape(hessian, {N, N}), expect_shape(gradient, {N}), expect_shape(columns, {n});
    expect_shape(information, {n, n}), expect_shape(vector, {n}), expect(is_ascending(columns, N), "columns must ascend");
    double* v = vector.data();
    std::fill(v, v + n, 0.0);
    for (int64_t i = 0; i < n; i++) {
        double *from = hessian.data() + columns(i) * N, *into = information.data() + i * n;
        for (int64_t j = i, end; j < n; j = end) {  // runs of adjacent columns
            for (end = j + 1; end < n && columns(end) == columns(end - 1) + 1; end++) {}
            std::copy(from + columns(j), from + columns(j) + (end - j), into + j);
        }
        std::fill(from + columns(i), from + N, 0.0);
        v[i] += vip::times_upper(into + i, n - i, value.data() + i, v + i) - gradient.data()[columns(i)];
        gradient.data()[columns(i)] = 0.0;
    }
}

// Adds a quadratic to a larger one, in which its variables have the ascending indices `places`.
static void add_at(nb::ndarray<const double, nb::ndim<2>, nb::device::cpu> added, In<1> added_vector, Indices<1> places,
                       Out<2> information, Out<1> vector) {
    const auto k = static_cast<int64_t>(added_vector.shape(0)), n = static_cast<int64_t>(vector.shape(0));
    expect(k == 0 || added.stride(1) == 1, "elements of a row must be adjacent"), expect_shape(added, {k, k});
    expect_shape(information, {n, n}), expect_shape(places, {k}), expect(is_ascending(places, n), "places must ascend");
    vip::add_upper(added.data(), added.stride(0), k, places.data(), information.data(), n);
    for (int64_t i = 0; i < k; i++) vector.data()[places(i)] += added_vector.data()[i];
}

// Outputs accept no array that needs conversion: results would be written into a copy.
NB_MODULE(_kernels, module) {
    using released = nb::call_guard<nb::gil_scoped_release>;
    const auto in = [](const char* name) { return nb::arg(name); };
    const auto out = [](const char* name) { return nb::arg(name).noconvert(); };
    module.def("exp", &over_stack<3, 9, vip::exp>, in("vectors"), out("R"), released());
    module.def("log", &over_stack<9, 3, vip::log>, in("R"), out("vectors"), released());
    module.def("right_jacobian", &over_stack<3, 9, vip::right_jacobian>, in("vectors"), out("J"), released());
    module.def("inverse_right_jacobian", &over_stack<3, 9, vip::inverse_right_jacobian>, in("vectors"), out("J"), released());
    module.def("pose_right_jacobian", &over_stack<6, 36, vip::pose_right_jacobian>, in("steps"), out("J"), released());
    module.def("hat", &over_stack<3, 9, vip::hat>, in("vectors"), out("M"), released());
    module.def("forward_kinematics", &forward_kinematics, in("R"), in("offsets"), in("root"), in("parents"), out("R_world"),
               out("p_world"), released());
    module.def("points", &points, in("R_world"), in("p_world"), in("bones"), in("offsets"), out("points"), released());
    module.def("screws", &screws, in("R_world"), in("p_world"), out("screws"), released());
    module.def("bend_cost", &bend_cost, in("headings_parent"), in("mountings_parent"), in("orientations_parent"),
               in("headings_child"), in("mountings_child"), in("orientations_child"), in("limits"), in("whitening"), out("cost"), released());
    module.def("follow_cameras", &follow_cameras, in("points"), in("image"), in("weight"), in("precision"), in("steps"), out("R"),
               out("t"), out("cost"), released());
    module.def("use_blas", &use_blas);
    module.def("eliminate", &eliminate, out("information"), out("vector"), in("first"), in("width"));
    module.def("substitute", &substitute, out("rows"), in("later"), out("values"));
    module.def("reorder", &reorder, in("information"), in("vector"), in("order"), out("reordered"), out("reordered_vector"));
    module.def("eliminate_stretch", &eliminate_stretch, in("rows"), in("gradient"), in("shared"), in("shared_gradient"), in("far"),
               in("tied"), in("border"), in("damping"), out("information"), out("vector"), out("conditionals"), out("d"), released());
    module.def("substitute_stretch", &substitute_stretch, out("conditionals"), in("far"), in("tied"), in("extra"), in("behind"), in("border"), out("steps"), released());
    module.def("slice_in_coordinates", &slice_in_coordinates, out("hessian"), out("gradient"), in("value"), in("columns"),
               out("information"), out("vector"));
    module.def("add_at", &add_at, in("added"), in("added_vector"), in("places"), out("information"), out("vector"));
    nb::class_<Target>(module, "Target")
        .def("__init__", &target_of_slices, out("hessian"), out("gradient"), nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
        .def("__init__", &target_of_stretch, out("rows"), out("gradient"), out("shared"), out("shared_gradient"), nb::keep_alive<1, 2>(),
             nb::keep_alive<1, 3>(), nb::keep_alive<1, 4>(), nb::keep_alive<1, 5>());
    nb::class_<BodySums>(module, "BodySums")
        .def("__init__", &make_body_sums, nb::keep_alive<1, 2>())
        .def("orientation", &add_orientation)
        .def("acceleration", &add_acceleration)
        .def("contact", &add_contact)
        .def("reprojection", &add_reprojection)
        .def("pose_prior", &add_pose_prior)
        .def("smoothness", &add_smoothness)
        .def("joint_limit", &add_joint_limit)
        .def("hinge", &add_hinge)
        .def("camera_orientation", &add_camera_orientation)
        .def("camera_acceleration", &add_camera_acceleration)
        .def("camera_velocity", &add_camera_velocity)
        .def("expand", &expand);
}
