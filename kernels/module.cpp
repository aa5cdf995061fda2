// vip_factors._kernels: what takes most of the time of small problems, where NumPy's calls cost more than arithmetic.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "rotations.hpp"
#include "slices.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using vip::BodySums, vip::Rows, vip::Slices;

template <int N> using In = nb::ndarray<const double, nb::ndim<N>, nb::c_contig, nb::device::cpu>;
template <int N> using Out = nb::ndarray<double, nb::ndim<N>, nb::c_contig, nb::device::cpu>;
template <int N> using Indices = nb::ndarray<const int64_t, nb::ndim<N>, nb::c_contig, nb::device::cpu>;

static void expect(bool is_so) {
    if (!is_so) throw nb::value_error("shapes do not match");
}

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

static Slices slices_in(Out<3> hessian, Out<2> gradient) {
    const auto T = static_cast<int64_t>(hessian.shape(0)), n = static_cast<int64_t>(hessian.shape(1));
    expect(hessian.shape(2) == hessian.shape(1) && gradient.shape(0) == hessian.shape(0) && gradient.shape(1) == hessian.shape(1));
    return {hessian.data(), gradient.data(), T, n};
}

// Every factor (t, n) of rows (t, n, m, groups · k + direct) that weighs anything.
template <class Take>
static void each_factor(const Slices& slices, int64_t first, int groups, int k, const In<4>& J, const In<3>& residual,
                        const In<2>& weight, const Indices<2>& columns, Take take) {
    const size_t T = J.shape(0), n = J.shape(1), m = J.shape(2), width = J.shape(3);
    expect(residual.shape(0) == T && residual.shape(1) == n && residual.shape(2) == m && weight.shape(0) == T);
    expect(weight.shape(1) == n && columns.shape(0) == n && columns.shape(1) + groups * k == width);
    expect(first >= 0 && first + static_cast<int64_t>(T) <= slices.frames);
    for (size_t i = 0; i < columns.size(); i++) expect(columns.data()[i] >= 0 && columns.data()[i] < slices.width);
    for (size_t t = 0; t < T; t++)
        for (size_t f = 0; f < n; f++) {
            const size_t at = t * n + f;
            const Rows rows{static_cast<int>(m), groups, k, static_cast<int>(columns.shape(1)), J.data() + at * m * width,
                            residual.data() + at * m, columns.data() + f * columns.shape(1), weight.data()[at]};
            if (rows.weight != 0) take(first + static_cast<int64_t>(t), t, f, rows);
        }
}

static void add_columns(Out<3> hessian, Out<2> gradient, int64_t first, In<4> J, In<3> residual, In<2> weight,
                        Indices<2> columns) {
    const Slices slices = slices_in(hessian, gradient);
    each_factor(slices, first, 0, 0, J, residual, weight, columns,
                [&](int64_t t, size_t, size_t, const Rows& rows) { BodySums::add_direct(slices, t, rows); });
}

static void add_bones(BodySums& sums, int64_t first, int k, Indices<1> bones, In<4> J, In<3> residual, In<2> weight,
                      Indices<2> columns) {
    expect(bones.shape(0) == J.shape(1));
    each_factor(sums.slices(), first, 1, k, J, residual, weight, columns,
                [&](int64_t t, size_t, size_t f, const Rows& rows) { sums.add(t, bones(f), rows); });
}

static void add_differences(BodySums& sums, int64_t first, Indices<1> bones, In<3> arms, In<1> coefficients, In<4> J,
                            In<3> residual, In<2> weight, Indices<2> columns) {
    const int groups = static_cast<int>(coefficients.shape(0)), direct = static_cast<int>(J.shape(3));
    const int width = 6 * groups + direct;
    expect(groups <= vip::FRAMES && bones.shape(0) == J.shape(1) && J.shape(2) == 3);
    expect(arms.shape(0) + 1 == J.shape(0) + coefficients.shape(0) && arms.shape(1) == bones.shape(0));
    std::vector<double> whole(3 * width);
    each_factor(sums.slices(), first, 0, 0, J, residual, weight, columns,
                [&](int64_t t, size_t at, size_t f, Rows rows) {
        std::fill(whole.begin(), whole.end(), 0.0);
        for (int g = 0; g < groups; g++) {  // a twist (ω, v) moves a point by ω × arm + v
            const double* arm = &arms(at + g, f, 0);
            const double away[3] = {-arm[0], -arm[1], -arm[2]};
            double crossing[9];
            vip::hat(away, crossing);
            for (int r = 0; r < 3; r++) {
                for (int c = 0; c < 3; c++) whole[r * width + 6 * g + c] = coefficients(g) * crossing[3 * r + c];
                whole[r * width + 6 * g + 3 + r] = coefficients(g);
            }
        }
        for (int r = 0; r < 3; r++)
            std::copy(rows.J + r * direct, rows.J + (r + 1) * direct, whole.data() + r * width + 6 * groups);
        rows.groups = groups, rows.k = 6, rows.J = whole.data();
        sums.add(t, bones(f), rows);
    });
}

// Coordinates of all joints together, in one frame or two: P (69, 69) between D (frames, t, 23, 3, 3); force (t, 69).
static void add_joints(BodySums& sums, int64_t first, In<5> D, In<2> P, In<1> weight, In<2> force) {
    const size_t frames = D.shape(0), T = D.shape(1), size = 9 * (vip::JOINTS - 1);
    expect(frames <= vip::FRAMES && D.shape(2) == vip::JOINTS - 1 && P.shape(0) == vip::POSE && P.shape(1) == vip::POSE);
    expect(weight.shape(0) == T && force.shape(0) == T && force.shape(1) == vip::POSE);
    expect(first >= 0 && first + static_cast<int64_t>(T) <= sums.slices().frames);
    for (size_t t = 0; t < T; t++)
        for (size_t i = 0; i < frames; i++) {
            const double* own = D.data() + (i * T + t) * size;
            const int64_t at = first + static_cast<int64_t>(t);
            for (size_t j = i; j < frames; j++)
                sums.add_joints(at, static_cast<int>(i), static_cast<int>(j), own, D.data() + (j * T + t) * size,
                                P.data(), weight(t));
            double* gradient = sums.slices().gradient + at * sums.slices().width + sums.column(static_cast<int>(i), 3);
            for (int a = 0; a < vip::JOINTS - 1; a++)
                for (int c = 0; c < 3; c++)
                    for (int r = 0; r < 3; r++) gradient[3 * a + c] += own[9 * a + 3 * r + c] * force(t, 3 * a + r);
        }
}

// Each joint by itself: D (t, 23, 3, 3), weights and residuals (t, 23, 3).
static void add_each_joint(BodySums& sums, int64_t first, In<4> D, In<3> residual, In<3> weight) {
    const Slices& slices = sums.slices();
    expect(D.shape(1) == vip::JOINTS - 1 && residual.size() * 3 == D.size() && weight.size() == residual.size());
    expect(first >= 0 && first + static_cast<int64_t>(D.shape(0)) <= slices.frames);
    for (size_t t = 0; t < D.shape(0); t++)
        for (size_t a = 0; a < D.shape(1); a++)
            for (int c = 0; c < 3; c++) {
                const int64_t at = first + static_cast<int64_t>(t), own = sums.column(0, 3 + 3 * static_cast<int64_t>(a));
                for (int r = 0; r < 3; r++) {
                    const double pushed = weight(t, a, r) * D(t, a, r, c);
                    slices.gradient[at * slices.width + own + c] += pushed * residual(t, a, r);
                    for (int d = c; d < 3; d++) slices.row(at, own + c)[own + d] += pushed * D(t, a, r, d);
                }
            }
}

static void expand(BodySums& sums, In<4> screws) {
    expect(static_cast<int64_t>(screws.shape(0)) == sums.slices().frames && screws.shape(1) == vip::SCREWS);
    sums.expand(screws.data());
}

NB_MODULE(_kernels, module) {
    using released = nb::call_guard<nb::gil_scoped_release>;
    module.def("exp", &over_stack<3, 9, vip::exp>, released());
    module.def("log", &over_stack<9, 3, vip::log>, released());
    module.def("right_jacobian", &over_stack<3, 9, vip::right_jacobian>, released());
    module.def("inverse_right_jacobian", &over_stack<3, 9, vip::inverse_right_jacobian>, released());
    module.def("hat", &over_stack<3, 9, vip::hat>, released());
    module.def("forward_kinematics", &forward_kinematics, released());
    module.def("screws", &screws, released());
    module.def("add_columns", &add_columns);
    nb::class_<BodySums>(module, "BodySums")
        .def("__init__", [](BodySums* self, Out<3> hessian, Out<2> gradient, int64_t first, int64_t frame,
                            Indices<1> parents, int64_t others) {
            expect(parents.shape(0) == vip::JOINTS);
            new (self) BodySums(slices_in(hessian, gradient), first, frame, parents.data(), others);
        }, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
        .def("add_bones", &add_bones)
        .def("add_differences", &add_differences)
        .def("add_joints", &add_joints)
        .def("add_each_joint", &add_each_joint)
        .def("expand", &expand);
}
