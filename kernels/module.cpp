// vip_factors._kernels: what takes most of the time of small problems, where NumPy's calls cost more than arithmetic.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string_view.h>

#include "cameras.hpp"
#include "elimination.hpp"
#include "links.hpp"
#include "people.hpp"
#include "rotations.hpp"
#include "samples.hpp"
#include "slices.hpp"
#include "terms.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using vip::BodySums, vip::Follows, vip::In, vip::Indices, vip::Mask, vip::Out, vip::Target, vip::expect;
using Flags = nb::ndarray<bool, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// One function of SO(3) over a stack (n, …).
template <int in, int out, void f(const double*, double*)> static void over_stack(In<2> from, Out<2> to) {
    expect(from.shape(1) == in && to.shape(1) == out && from.shape(0) == to.shape(0));
    for (size_t i = 0; i < from.shape(0); i++) f(from.data() + in * i, to.data() + out * i);
}

static void forward_kinematics(In<4> R, In<2> offsets, In<2> root, Indices<1> parents, Out<4> R_world, Out<3> p_world) {
    const size_t J = parents.shape(0);
    expect(R.shape(1) == J && offsets.shape(0) == J && root.shape(0) == R.shape(0) && R_world.size() == R.size());
    for (size_t t = 0; t < R.shape(0); t++) {
        const double* own = R.data() + 9 * J * t;
        double *R_of = R_world.data() + 9 * J * t, *p_of = p_world.data() + 3 * J * t;
        std::copy(own, own + 9, R_of);
        std::copy(&root(t, 0), &root(t, 0) + 3, p_of);
        for (size_t j = 1; j < J; j++) {
            const size_t parent = static_cast<size_t>(parents(j));
            vip::product<3, 3, 3>(R_of + 9 * parent, own + 9 * j, R_of + 9 * j);
            vip::product<3, 3, 1>(R_of + 9 * parent, &offsets(j, 0), p_of + 3 * j);
            for (int c = 0; c < 3; c++) p_of[3 * j + c] += p_of[3 * parent + c];
        }
    }
}

static void points(In<4> R_world, In<3> p_world, Indices<1> bones, In<2> offsets, Out<3> found) {
    const size_t T = R_world.shape(0), J = R_world.shape(1), n = bones.shape(0);
    expect(p_world.size() == 3 * T * J && offsets.size() == 3 * n && found.size() == 3 * T * n);
    for (size_t i = 0; i < n; i++) {
        const auto bone = static_cast<size_t>(bones(i));
        expect(bone < J);
        for (size_t t = 0; t < T; t++) {
            vip::product<3, 3, 1>(R_world.data() + 9 * (J * t + bone), &offsets(i, 0), &found(t, i, 0));
            for (size_t c = 0; c < 3; c++) found(t, i, c) += p_world(t, bone, c);
        }
    }
}

static void screws(In<4> R_world, In<3> p_world, Out<4> out) {
    const size_t J = R_world.shape(1);
    expect(out.shape(0) == R_world.shape(0) && out.shape(1) == J + 1 && p_world.shape(1) == J);
    std::fill(out.data(), out.data() + out.size(), 0.0);
    for (size_t t = 0; t < R_world.shape(0); t++) {
        const double *R = R_world.data() + 9 * J * t, *p = p_world.data() + 3 * J * t;
        double* into = out.data() + 18 * (J + 1) * t;
        for (size_t j = 0; j < J; j++) {
            const double arm[3] = {p[3 * j] - p[0], p[3 * j + 1] - p[1], p[3 * j + 2] - p[2]};
            double crossing[9];
            vip::hat(arm, crossing);
            std::copy(R + 9 * j, R + 9 * j + 9, into + 18 * j);
            vip::product<3, 3, 3>(crossing, R + 9 * j, into + 18 * j + 9);
        }
        for (int c = 0; c < 3; c++) into[18 * J + 9 + 4 * c] = 1.0;
    }
}

// Keypoints (F, W, K, 3) of bodies against rays (F, N, K, 2) and weights (F, N, K); the fits (F, W, N, 4).
static void fit_people(In<4> points, In<4> rays, In<3> weight, In<2> known, In<1> major, In<1> precision, In<4> covariance,
                       double depth_share, double side, Out<4> fits) {
    const size_t F = points.shape(0), W = points.shape(1), K = points.shape(2), N = rays.shape(1);
    expect(fits.shape(0) == F && fits.shape(1) == W && fits.shape(2) == N && fits.shape(3) == 4 && points.shape(3) == 3);
    expect(rays.size() == F * N * K * 2 && weight.size() == F * N * K && known.size() == W * K && major.size() == K);
    expect(precision.size() == K && covariance.size() == F * W * 9);
    for (size_t f = 0; f < F; f++)
        for (size_t w = 0; w < W; w++) {
            const vip::Keypoints keypoints{static_cast<int64_t>(K), known.data() + w * K, major.data(), precision.data()};
            for (size_t n = 0; n < N; n++)
                vip::fit_person(keypoints, points.data() + (f * W + w) * K * 3, rays.data() + (f * N + n) * K * 2,
                                weight.data() + (f * N + n) * K, covariance.data() + (f * W + w) * 9, depth_share, side,
                                fits.data() + ((f * W + w) * N + n) * 4);
        }
}

// Points (P, K, 3) and where they were seen (P, K, 2), weights and precisions (P, K); cameras (P, 3, 3) and (P, 3) which are
// followed, and their costs (P).
static void follow_cameras(In<3> points, In<3> seen, In<2> weight, In<2> precision, int64_t steps, Out<3> R, Out<2> t, Out<1> cost) {
    const size_t P = points.shape(0), K = points.shape(1);
    expect(points.shape(2) == 3 && seen.size() == P * K * 2 && weight.size() == P * K && precision.size() == P * K);
    expect(R.size() == P * 9 && t.size() == P * 3 && cost.size() == P);
    for (size_t i = 0; i < P; i++) {
        const vip::Sighting sighting{static_cast<int64_t>(K), points.data() + i * K * 3, seen.data() + i * K * 2,
                                     weight.data() + i * K, precision.data() + i * K};
        cost(i) = vip::follow_camera(sighting, steps, R.data() + i * 9, t.data() + i * 3);
    }
}

// Of either end of a link quaternions of headings (K, 4), mountings (K, M, 4) and orientations (T, 4); of the bend its
// mean and limits (3, 3) and whitening (3, 3); the costs (K * M, K * M).
static void bend_cost(In<2> about_parent, In<3> parent, In<2> turned_parent, In<2> about_child, In<3> child, In<2> turned_child,
                      In<2> limits, In<2> whitening, Out<2> found) {
    const auto end = [](const In<2>& about, const In<3>& mounting, const In<2>& turned) {
        expect(about.shape(1) == 4 && mounting.shape(2) == 4 && turned.shape(1) == 4 && about.shape(0) == mounting.shape(0));
        return vip::LinkEnd{about.data(), mounting.data(), turned.data(), static_cast<int64_t>(mounting.shape(0)),
                            static_cast<int64_t>(mounting.shape(1))};
    };
    const vip::LinkEnd above = end(about_parent, parent, turned_parent), below = end(about_child, child, turned_child);
    expect(turned_parent.shape(0) == turned_child.shape(0) && limits.size() == 9 && whitening.size() == 9);
    expect(static_cast<int64_t>(found.shape(0)) == above.size() && static_cast<int64_t>(found.shape(1)) == below.size());
    vip::bend_cost(above, below, static_cast<int64_t>(turned_parent.shape(0)), limits.data(), whitening.data(), found.data());
}

// Of sums of products (L, 5, 4, 4) the least misfit (L) and its heading (L).
static void least_over_headings(In<4> products, Out<1> cost, Out<1> heading) {
    expect(products.size() == 80 * cost.shape(0) && heading.shape(0) == cost.shape(0));
    for (size_t l = 0; l < cost.shape(0); l++) cost(l) = vip::least_over_headings(products.data() + 80 * l, &heading(l));
}

// Of two sensors (T, 3, 4).
static double joint_share(In<3> above, In<3> below) {
    expect(above.shape(1) == 3 && above.shape(2) == 4 && above.shape(0) > 0 && below.size() == above.size());
    return vip::joint_share(above.data(), below.data(), static_cast<int64_t>(above.shape(0)));
}

// Of a sensor (T, 3, 4) and a spline's coefficients (N, 3, 4): seconds, sigma, share.
static void joint_delay(In<3> above, In<3> below, In<1> place, Indices<1> block, double step, double reach, double seconds,
                        double heading, Out<1> found) {
    const auto T = static_cast<int64_t>(above.shape(0));
    expect(T > 0 && above.size() == 12 * place.shape(0) && block.shape(0) == place.shape(0) && below.shape(1) == 3);
    const double far = reach / step, last = static_cast<double>(below.shape(0)) - 5;  // knots are even but for both ends
    expect(below.shape(2) == 4 && found.shape(0) == 3 && std::abs(seconds) <= reach);
    for (int64_t t = 0; t < T; t++) expect(place(t) - far >= 4 && place(t) + far <= last);
    const vip::JointDelay one = vip::joint_delay(above.data(), below.data(), place.data(), block.data(), T, step, reach, seconds, heading);
    found(0) = one.seconds, found(1) = one.sigma, found(2) = one.share;
}

// Of each of S sensors its first `count` samples of (S, n), (S, n, 9), (S, n, 3); R (S, 3, 3) and force (S, 3).
static void measure(In<2> time, In<3> R, In<3> force, Indices<1> count, In<1> period, double at, double step,
                    double gap_factor, Out<3> found_R, Flags seen, Out<2> found_force, Flags whole) {
    const size_t S = time.shape(0), n = time.shape(1);
    expect(R.size() == 9 * S * n && force.size() == 3 * S * n && count.size() == S && period.size() == S);
    expect(found_R.size() == 9 * S && found_force.size() == 3 * S && seen.size() == S && whole.size() == S);
    for (size_t s = 0; s < S; s++) {
        expect(count(s) >= 0 && count(s) <= static_cast<int64_t>(n));
        const vip::Samples samples{&time(s, 0), &R(s, 0, 0), &force(s, 0, 0), count(s), period(s)};
        const vip::Covered covered = vip::measure(samples, at, step, gap_factor, &found_R(s, 0, 0), &found_force(s, 0));
        seen(s) = covered.orientation, whole(s) = covered.acceleration;
    }
}

// Slices (T, n, n) and (T, n).
static void in_slices(Target* target, Out<3> hessian, Out<2> gradient) {
    const auto T = static_cast<int64_t>(hessian.shape(0)), n = static_cast<int64_t>(hessian.shape(1));
    expect(hessian.shape(2) == hessian.shape(1) && gradient.shape(0) == hessian.shape(0) && gradient.shape(1) == hessian.shape(1));
    new (target) Target{std::vector<double*>(n), std::vector<double*>(n), std::vector<int64_t>(n, n * n),
                        std::vector<int64_t>(n, n), std::vector<int>(n, 0), {std::vector<int64_t>(n)}, T};
    for (int64_t c = 0; c < n; c++) {
        target->rows[c] = hessian.data() + c * n, target->gradients[c] = gradient.data() + c;
        target->orders[0][c] = c;
    }
}

// Of frames (T, w, m) and (T, w) what has its rows there: the column of the first in a slice, how many frames after the
// slice's it is, and where in the rows the slice's columns (n) are, below nought where they never are. The last columns
// of a slice are shared: (s, s) and (s). From frame `begin` on.
static void in_chains(Target* target, nb::list chains, Out<2> shared, Out<1> shared_gradient, int64_t columns, int64_t begin, int64_t frames) {
    const auto n = columns, s = static_cast<int64_t>(shared.shape(0));
    expect(shared.shape(1) == shared.shape(0) && shared_gradient.shape(0) == shared.shape(0) && s <= n);
    new (target) Target{std::vector<double*>(n), std::vector<double*>(n), std::vector<int64_t>(n, 0),
                        std::vector<int64_t>(n, 0), std::vector<int>(n, 0), {}, frames};
    for (nb::handle item : chains) {
        const nb::tuple one = nb::cast<nb::tuple>(item);
        const auto rows = nb::cast<Out<3>>(one[0]);
        const auto gradient = nb::cast<Out<2>>(one[1]);
        const auto first = nb::cast<int64_t>(one[2]), ahead = nb::cast<int64_t>(one[3]);
        const auto places = nb::cast<Indices<1>>(one[4]);
        const auto w = static_cast<int64_t>(rows.shape(1)), m = static_cast<int64_t>(rows.shape(2));
        expect(static_cast<int64_t>(places.shape(0)) == n && gradient.shape(1) == rows.shape(1) && first >= 0 && first + w <= n - s);
        expect(begin >= 0 && begin + frames <= static_cast<int64_t>(rows.shape(0)) && gradient.shape(0) == rows.shape(0));
        for (int64_t c = 0; c < n; c++) expect(places(c) < m);
        for (int64_t c = 0; c < w; c++) {
            target->rows[first + c] = rows.data() + ((begin + ahead) * w + c) * m, target->row_step[first + c] = w * m;
            target->gradients[first + c] = gradient.data() + (begin + ahead) * w + c, target->gradient_step[first + c] = w;
            target->kind[first + c] = static_cast<int>(target->orders.size());
        }
        target->orders.emplace_back(places.data(), places.data() + n);
    }
    for (int64_t c = 0; c < s; c++) {
        target->rows[n - s + c] = shared.data() + c * s, target->gradients[n - s + c] = shared_gradient.data() + c;
        target->kind[n - s + c] = static_cast<int>(target->orders.size());
    }
    target->orders.emplace_back(n, -1);
    for (int64_t c = 0; c < s; c++) target->orders.back()[n - s + c] = c;
}

// A body's sums, from the frame `begin` on; see BodySums.
static void in_body(BodySums* self, const Target& target, int64_t begin, In<4> R, In<3> p, In<4> turns, int64_t first,
                    int64_t frame, Indices<1> parents, Indices<1> columns, In<3> directions) {
    expect(parents.shape(0) == vip::JOINTS && columns.shape(0) == vip::BLOCKS && p.shape(1) == R.shape(1));
    expect(R.shape(1) == vip::JOINTS || (R.size() == 0 && first < 0));  // none: of a camera alone
    expect(p.shape(0) == R.shape(0) && (turns.size() == 0 || turns.size() >= R.size()) && directions.shape(2) <= 60);
    expect(begin >= 0 && begin + target.frames <= static_cast<int64_t>(R.shape(0)));
    const vip::Bones bones{R.data(), p.data(), turns.size() ? turns.data() : nullptr, static_cast<int64_t>(R.shape(0))};
    new (self) BodySums(target, begin, bones, first, frame, parents.data(), columns.data(),
                        directions.size() ? directions.data() : nullptr, static_cast<int>(directions.shape(2)));
    self->later([R, p, turns, directions](int64_t) {});  // keeps the arrays
}

static vip::Believed believed(std::string_view loss, double k, double share) { return {loss[0], k, share}; }

static vip::MovingPoints moving(BodySums& sums, Indices<1> bones, In<2> p_bone, In<3> shift) {
    expect(p_bone.shape(0) == bones.size() && p_bone.shape(1) == 3);
    expect(sums.lengths() == 0 || (shift.shape(0) == bones.size() && static_cast<int>(shift.shape(2)) == sums.lengths()));
    for (size_t i = 0; i < bones.size(); i++) expect(bones(i) >= 0 && bones(i) < vip::JOINTS);
    return {sums, bones, p_bone, shift, {}, {}, {}, {}, {}, {}};
}

static bool of_all(const BodySums& sums, size_t frames) { return static_cast<int64_t>(frames) == sums.bones().frames; }

static void add_orientation(BodySums& sums, Indices<1> bones, In<3> mounting, In<2> headings, In<4> measured, Mask valid,
                            double sigma, std::string_view loss, double k, double share, In<3> charts) {
    const size_t n = bones.size();
    expect(mounting.shape(0) == n && headings.shape(1) == n && measured.shape(1) == n && valid.shape(1) == n);
    expect(of_all(sums, measured.shape(0)) && of_all(sums, valid.shape(0)) && (charts.size() == 0 || charts.shape(0) == n));
    expect(headings.shape(0) == 1 || of_all(sums, headings.shape(0)));
    sums.later(vip::Orientation{sums, bones, mounting, headings, measured, valid, sigma, believed(loss, k, share), charts});
}

static void add_acceleration(BodySums& sums, Indices<1> bones, In<2> p_bone, In<3> shift, In<2> headings, In<3> force, Mask valid,
                             double step, double sigma, std::string_view loss, double k, double share) {
    const size_t n = bones.size();
    expect(headings.shape(1) == n && force.shape(1) == n && valid.shape(1) == n);
    expect(of_all(sums, force.shape(0)) && of_all(sums, valid.shape(0)) && (headings.shape(0) == 1 || of_all(sums, headings.shape(0))));
    sums.later(vip::Acceleration{moving(sums, bones, p_bone, shift), headings, force, valid, step, sigma, believed(loss, k, share)});
}

static void add_contact(BodySums& sums, Indices<1> bones, In<2> p_bone, In<3> shift, In<2> confidence, double sole, double step,
                        double sigma, std::string_view loss, double k, double share, Follows follows) {
    expect(confidence.shape(1) == bones.size() && of_all(sums, confidence.shape(0)));
    expect(follows.size() == 0 || of_all(sums, follows.size() + 1));
    sums.later(vip::Contact{moving(sums, bones, p_bone, shift), confidence, sole, step, sigma, believed(loss, k, share), follows});
}

static void add_reprojection(BodySums& sums, Indices<1> bones, In<2> p_bone, In<3> shift, In<3> R_camera, In<2> p_camera,
                             In<1> lens, In<3> pixels, In<2> sigma, Mask seen, In<3> speed, In<1> late, In<1> since,
                             std::string_view loss, double k, double share, bool variables, In<3> charts, Indices<1> items,
                             In<2> signs) {
    const size_t n = bones.size();
    for (size_t width : {pixels.shape(1), sigma.shape(1), seen.shape(1), speed.shape(1), items.size(), signs.shape(0)}) expect(width == n);
    for (size_t frames : {pixels.shape(0), sigma.shape(0), seen.shape(0), speed.shape(0), late.size(), since.size()}) expect(of_all(sums, frames));
    for (size_t frames : {R_camera.shape(0), p_camera.shape(0)}) expect(frames == 1 || of_all(sums, frames));
    expect(lens.size() == 12 && (charts.size() == 0 || charts.shape(0) == 1 || of_all(sums, charts.shape(0))));
    vip::Lens model;
    std::copy(lens.data(), lens.data() + 12, reinterpret_cast<double*>(&model));
    sums.later(vip::Reprojection{moving(sums, bones, p_bone, shift), R_camera, p_camera, model, pixels, sigma, seen, speed, late,
                                 since, believed(loss, k, share), variables, charts, items, signs});
}

static void add_pose_prior(BodySums& sums, In<4> R, In<2> information, In<1> mean, double weight) {
    expect(of_all(sums, R.shape(0)) && information.size() == vip::POSE * vip::POSE && mean.size() == vip::POSE);
    sums.later(vip::PosePrior{sums, R, information, mean, weight});
}

static void add_smoothness(BodySums& sums, In<4> R, In<2> information, Follows follows, double weight) {
    expect(of_all(sums, R.shape(0)) && information.size() == vip::POSE * vip::POSE && of_all(sums, follows.size() + 1));
    sums.later(vip::Smoothness{sums, R, information, follows, weight});
}

static void add_joint_limit(BodySums& sums, In<4> R, In<1> lower, In<1> upper, double sigma, bool per_axis, std::string_view loss,
                            double k, double share) {
    expect(of_all(sums, R.shape(0)) && lower.size() == vip::POSE && upper.size() == vip::POSE);
    sums.later(vip::JointLimit{sums, R, lower, upper, sigma, per_axis, believed(loss, k, share)});
}

static void add_hinge(BodySums& sums, In<4> R, Indices<1> hinges, Indices<1> joints, In<2> square, In<2> axes, In<3> by_tilts,
                      In<1> offsets, In<1> whitening, std::string_view loss, double k, double share) {
    const size_t n = hinges.size();
    expect(of_all(sums, R.shape(0)) && n > 0 && n <= 16 && joints.size() == n && offsets.size() == n && whitening.size() == n);
    expect(square.size() == 3 * n && axes.size() == 3 * n && by_tilts.size() == 6 * n);
    sums.later(vip::Hinge{sums, R, hinges, joints, square, axes, by_tilts, offsets, whitening, believed(loss, k, share)});
}

static vip::Camera camera(BodySums& sums, In<3> R, In<2> p, In<3> charts) {
    for (size_t frames : {R.shape(0), p.shape(0)}) expect(frames == 1 || of_all(sums, frames));
    expect(R.size() == 9 * R.shape(0) && p.size() == 3 * p.shape(0));
    expect(charts.size() == 0 || charts.size() == 36 || charts.size() == 36 * static_cast<size_t>(sums.bones().frames));
    return {sums, R, p, charts};
}

static void add_camera_orientation(BodySums& sums, In<3> R, In<2> p, In<3> charts, In<2> mounting, double heading, In<4> measured,
                                   Mask valid, double sigma, std::string_view loss, double k, double share, In<3> chart) {
    expect(mounting.size() == 9 && of_all(sums, valid.shape(0)) && measured.size() == 9 * valid.shape(0));
    sums.later(vip::CameraOrientation{camera(sums, R, p, charts), mounting, heading, measured, valid, sigma, believed(loss, k, share), chart});
}

static void add_camera_acceleration(BodySums& sums, In<3> R, In<2> p, In<3> charts, In<1> place, double heading, In<3> force,
                                    Mask valid, double step, double sigma, std::string_view loss, double k, double share) {
    expect(place.size() == 3 && of_all(sums, valid.shape(0)) && force.size() == 3 * valid.shape(0));
    sums.later(vip::CameraAcceleration{camera(sums, R, p, charts), place, heading, force, valid, step, sigma, believed(loss, k, share)});
}

static void add_camera_velocity(BodySums& sums, In<3> R, In<2> p, In<3> charts, double step, In<1> sigmas, std::string_view loss,
                                double k, double share) {
    expect(sigmas.size() == 6);
    sums.later(vip::CameraVelocity{camera(sums, R, p, charts), step, sigmas, believed(loss, k, share)});
}

static void expand(BodySums& sums) {
    nb::gil_scoped_release released;  // stretches are summed side by side
    sums.expand();
}

static vip::Blas blas;

// SciPy's functions, from what its Cython modules offer to others.
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

// The variables first … first + width, of which those before are eliminated already.
static bool eliminate(Out<2> information, Out<1> vector, int first, int width) {
    const auto n = static_cast<int>(vector.shape(0));
    expect(information.shape(0) == information.shape(1) && information.shape(0) == vector.shape(0));
    expect(first >= 0 && width >= 0 && first + width <= n);
    double* rows = information.data() + (n + 1) * static_cast<int64_t>(first);
    return vip::eliminate(blas, rows, vector.data() + first, n, n - first, width, rows + (n + 1) * static_cast<int64_t>(width), n);
}

// Some variables of a quadratic, in another order.
static void reorder(In<2> information, In<1> vector, Indices<1> order, Out<2> into, Out<1> into_vector) {
    const size_t n = vector.shape(0), k = order.shape(0);
    expect(information.shape(0) == n && information.shape(1) == n);
    expect(into.shape(0) == k && into.shape(1) == k && into_vector.shape(0) == k);
    for (size_t i = 0; i < k; i++) {
        const int64_t one = order(i);
        expect(one >= 0 && one < static_cast<int64_t>(n));
        into_vector(i) = vector(one);
        double* row = &into(i, 0);
        for (size_t j = i, end; j < k; j = end) {  // in runs of columns that stay beside each other
            for (end = j + 1; end < k && order(end) == order(end - 1) + 1; end++) {}
            const double* from = information.data() + order(j) * n + one;  // down a column, or along a row
            if (order(j) >= one) std::copy(&information(one, order(j)), &information(one, order(j)) + (end - j), row + j);
            else
                for (size_t l = j; l < end; l++, from += n) row[l] = *from;
        }
    }
}

// R and S (w, n), with the stride of the matrix that they lie in.
using Matrix = nb::ndarray<double, nb::ndim<2>, nb::device::cpu>;

static bool ascending(Indices<1> places, int64_t end) {
    for (size_t i = 0; i < places.size(); i++)
        if (places(i) < (i == 0 ? 0 : places(i - 1) + 1) || places(i) >= end) return false;
    return true;
}

static vip::Conditional conditional(Matrix rows, const double* d) {
    expect((rows.size() == 0 || rows.stride(1) == 1) && rows.shape(0) <= rows.shape(1));
    return {rows.data(), d, static_cast<int>(rows.stride(0)), static_cast<int>(rows.shape(1)), static_cast<int>(rows.shape(0))};
}

static vip::Conditional conditional(nb::handle rows, nb::handle d) {
    const auto right = nb::cast<In<1>>(d);
    const vip::Conditional found = conditional(nb::cast<Matrix>(rows), right.data());
    expect(static_cast<int>(right.shape(0)) == found.w);
    return found;
}

static void forward(Matrix rows, Out<2> right, Out<2> behind) {
    const vip::Conditional of = conditional(rows, nullptr);
    expect(static_cast<int>(right.shape(0)) == of.w && static_cast<int>(behind.shape(0)) == of.n - of.w && behind.shape(1) == right.shape(1));
    vip::forward(blas, of, right.data(), behind.data(), static_cast<int>(right.shape(1)));
}

// Of each frame R and S, and d; and where what is shared steps behind it, the same of that.
static void substitute_lag(nb::list frames, Indices<1> far, In<1> shared, Out<2> values) {
    expect(frames.size() == values.shape(0));
    const auto T = static_cast<int64_t>(frames.size()), w = static_cast<int64_t>(values.shape(1));
    const auto s = static_cast<int64_t>(shared.shape(0));
    std::vector<double> later, own_shared(shared.data(), shared.data() + s);
    for (int64_t t = T - 1; t >= 0; t--) {
        const nb::tuple one = nb::cast<nb::tuple>(frames[t]);
        double* value = values.data() + t * w;
        later.clear();
        if (t + 1 < T) later.assign(value + w, value + 2 * w);
        for (size_t i = 0; t + 2 < T && i < far.size(); i++) expect(0 <= far(i) && far(i) < w), later.push_back(value[2 * w + far(i)]);
        const auto ahead = static_cast<int64_t>(later.size());
        later.insert(later.end(), own_shared.begin(), own_shared.end());
        if (one.size() > 2) {
            const vip::Conditional step = conditional(one[2], one[3]);
            expect(step.w == s && step.n == s + ahead + s);
            vip::substitute(blas, step, later.data(), own_shared.data());
            std::copy(own_shared.begin(), own_shared.end(), later.begin() + ahead);
        }
        const vip::Conditional own = conditional(one[0], one[1]);
        expect(own.w == w && own.n == w + ahead + s);
        vip::substitute(blas, own, later.data(), value);
    }
}

// Pieces: blocks (t, r, c) of some frames' rows in a matrix, with the first row, column and frame.
static bool eliminate_chain(nb::list pieces, In<2> gradient, In<1> damping, int ahead, Out<2> information, Out<1> vector,
                            Out<3> rows, Out<2> d) {
    const vip::EliminatedChain into{static_cast<int64_t>(rows.shape(0)), static_cast<int>(rows.shape(1)), ahead,
                                    static_cast<int>(rows.shape(2)), rows.data(), d.data()};
    expect(ahead >= 0 && into.w + ahead <= into.n && vector.size() + rows.shape(1) == rows.shape(2));
    expect(information.shape(0) == vector.size() && information.shape(1) == vector.size());
    expect(damping.size() == rows.shape(1) && gradient.size() == d.size() && d.size() == rows.shape(0) * rows.shape(1));
    std::vector<vip::Piece> found;
    for (nb::handle item : pieces) {
        const nb::tuple one = nb::cast<nb::tuple>(item);
        const auto blocks = nb::cast<nb::ndarray<const double, nb::ndim<3>, nb::device::cpu>>(one[0]);
        found.push_back({blocks.data(), blocks.stride(0), blocks.stride(1), blocks.stride(2), static_cast<int64_t>(blocks.shape(1)),
                         static_cast<int64_t>(blocks.shape(2)), nb::cast<int64_t>(one[1]), nb::cast<int64_t>(one[2]),
                         nb::cast<int64_t>(one[3]), static_cast<int64_t>(blocks.shape(0))});
        expect(found.back().first >= 0 && found.back().first + found.back().frames <= into.frames);
        expect(found.back().row >= 0 && found.back().column >= 0);
        expect(found.back().row + found.back().rows <= into.w && found.back().column + found.back().columns <= into.n);
    }
    nb::gil_scoped_release released;
    return vip::eliminate_chain(blas, found, gradient.data(), damping.data(), information.data(), vector.data(), into);
}

// `steps` (T, w) hold d, and then the steps.
static void substitute_chain(Out<3> rows, In<1> behind, int ahead, Out<2> steps) {
    const vip::EliminatedChain chain{static_cast<int64_t>(rows.shape(0)), static_cast<int>(rows.shape(1)), ahead,
                                     static_cast<int>(rows.shape(2)), rows.data(), steps.data()};
    expect(steps.size() == rows.shape(0) * rows.shape(1) && chain.n - chain.w == static_cast<int>(behind.size()) && ahead <= chain.n - chain.w);
    vip::substitute_chain(blas, behind.data(), chain);
}

// Of a slice (N, N) ascending columns as a quadratic in x, in the rows of these. The slice is zero then, as far as it
// counts: here each row is at hand.
static void slice_in_coordinates(Out<2> hessian, Out<1> gradient, In<1> value, Indices<1> columns, Out<2> information, Out<1> vector) {
    const auto N = static_cast<int64_t>(hessian.shape(0)), n = static_cast<int64_t>(value.shape(0));
    expect(hessian.shape(1) == hessian.shape(0) && gradient.shape(0) == hessian.shape(0) && columns.shape(0) == value.shape(0));
    expect(information.shape(0) == value.shape(0) && information.shape(1) == value.shape(0) && vector.shape(0) == value.shape(0));
    expect(ascending(columns, N));
    double* v = vector.data();
    std::fill(v, v + n, 0.0);
    for (int64_t i = 0; i < n; i++) {
        double *from = hessian.data() + columns(i) * N, *into = information.data() + i * n;
        for (int64_t j = i, end; j < n; j = end) {  // in runs of columns that stay beside each other
            for (end = j + 1; end < n && columns(end) == columns(end - 1) + 1; end++) {}
            std::copy(from + columns(j), from + columns(j) + (end - j), into + j);
        }
        std::fill(from + columns(i), from + N, 0.0);
        v[i] += vip::times_upper(into + i, n - i, value.data() + i, v + i) - gradient.data()[columns(i)];
        gradient.data()[columns(i)] = 0.0;
    }
}

// What is known before of columns at these places.
static void add_before(nb::ndarray<const double, nb::ndim<2>, nb::device::cpu> before, In<1> before_vector, Indices<1> places,
                       Out<2> information, Out<1> vector) {
    const auto k = static_cast<int64_t>(before_vector.shape(0)), n = static_cast<int64_t>(vector.shape(0));
    expect((k == 0 || before.stride(1) == 1) && before.shape(0) == before_vector.shape(0) && before.shape(1) == before.shape(0));
    expect(information.shape(0) == vector.shape(0) && information.shape(1) == vector.shape(0));
    expect(places.shape(0) == before_vector.shape(0) && ascending(places, n));
    vip::add_upper(before.data(), before.stride(0), k, places.data(), information.data(), n);
    for (int64_t i = 0; i < k; i++) vector.data()[places(i)] += before_vector.data()[i];
}

NB_MODULE(_kernels, module) {
    using released = nb::call_guard<nb::gil_scoped_release>;
    module.def("exp", &over_stack<3, 9, vip::exp>, released());
    module.def("log", &over_stack<9, 3, vip::log>, released());
    module.def("right_jacobian", &over_stack<3, 9, vip::right_jacobian>, released());
    module.def("inverse_right_jacobian", &over_stack<3, 9, vip::inverse_right_jacobian>, released());
    module.def("pose_right_jacobian", &over_stack<6, 36, vip::pose_right_jacobian>, released());
    module.def("hat", &over_stack<3, 9, vip::hat>, released());
    module.def("forward_kinematics", &forward_kinematics, released());
    module.def("points", &points, released());
    module.def("screws", &screws, released());
    module.def("measure", &measure, released());
    module.def("bend_cost", &bend_cost, released());
    module.def("least_over_headings", &least_over_headings, released());
    module.def("joint_delay", &joint_delay, released());
    module.def("joint_share", &joint_share, released());
    module.def("follow_cameras", &follow_cameras, released());
    module.def("fit_people", &fit_people, released());
    module.def("use_blas", &use_blas);
    module.def("eliminate", &eliminate);
    module.def("reorder", &reorder);
    module.def("substitute_lag", &substitute_lag);
    module.def("forward", &forward);
    module.def("eliminate_chain", &eliminate_chain);
    module.def("substitute_chain", &substitute_chain);
    module.def("slice_in_coordinates", &slice_in_coordinates);
    module.def("add_before", &add_before);
    nb::class_<Target>(module, "Target")
        .def("__init__", &in_slices, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
        .def("__init__", &in_chains, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>(), nb::keep_alive<1, 4>());
    nb::class_<BodySums>(module, "BodySums")
        .def("__init__", &in_body, nb::keep_alive<1, 2>())
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
