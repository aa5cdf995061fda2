// Samples of a sensor about a frame: live/sensor_samples.py, whose SensorBuffer.measure this is.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "rotations.hpp"

namespace vip {

// One sensor's samples in the order of time: seconds (n), rotations (n, 9), specific forces (n, 3); its period.
struct Samples {
    const double *time, *R, *force;
    int64_t count;
    double period;
};

struct Covered { bool orientation, acceleration; };

// Of the triangle of area one over [−h, h] the second antiderivative.
inline double second_antiderivative(double time, double h) {
    const double t = std::clamp(time, -h, h), later = std::max(t, 0.0);
    return ((t + h) * (t + h) * (t + h) - 2 * later * later * later) / (6 * h * h) + std::max(time - h, 0.0);
}

// Orientation (9) at an instant, average force (3) about the one `step` before it; and which of them are measured.
inline Covered measure(const Samples& of, double at, double step, double gap_factor, double* R, double* force) {
    std::fill(R, R + 9, 0.0), R[0] = R[4] = R[8] = 1.0;
    std::fill(force, force + 3, 0.0);
    if (!of.count) return {false, false};
    const double start = at - 2 * step, slack = 0.5 * of.period, *behind = of.time + of.count;
    const int64_t newest = of.count - 1;
    const int64_t first = std::max<int64_t>(std::min<int64_t>(std::upper_bound(of.time, behind, start) - of.time, newest) - 1, 0);
    const int64_t last = std::min(std::max<int64_t>(std::lower_bound(of.time, behind, at) - of.time, first + 1), newest);
    Covered found{at >= of.time[first] - slack && at <= of.time[last] + slack, false};
    found.acceleration = of.count > 1 && start >= of.time[first] - slack && at <= of.time[last] + slack;
    for (int64_t i = first; i < last; i++) {
        const double before = of.time[i], after = of.time[i + 1];
        if (after - before <= gap_factor * of.period || at <= before + slack) continue;
        found.orientation &= at >= after - slack, found.acceleration &= start >= after - slack;
    }
    if (found.orientation) {
        const int64_t behind_it = std::upper_bound(of.time + first, of.time + last + 1, at) - of.time;
        const int64_t right = std::min(std::max(behind_it, first + 1), last), left = std::max(right - 1, first);
        const double span = of.time[right] - of.time[left];
        const double share = std::clamp((at - of.time[left]) / (span > 0 ? span : 1.0), 0.0, 1.0);
        double between[9], turn[3];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                between[3 * i + j] = 0;
                for (int k = 0; k < 3; k++) between[3 * i + j] += of.R[9 * left + 3 * k + i] * of.R[9 * right + 3 * k + j];
            }
        log(between, turn);
        for (double& one : turn) one *= share;
        exp(turn, between);
        product<3, 3, 3>(of.R + 9 * left, between, R);
    }
    if (!found.acceleration) return found;
    const double middle = at - step, earliest = second_antiderivative(of.time[first] - middle, step);
    double G = earliest, slope[3] = {0, 0, 0}, average[3];
    std::copy(of.force + 3 * last, of.force + 3 * last + 3, average);
    for (int64_t i = first; i < last; i++) {
        const double next = second_antiderivative(of.time[i + 1] - middle, step);
        for (int c = 0; c < 3; c++) {
            slope[c] = (of.force[3 * i + 3 + c] - of.force[3 * i + c]) / (of.time[i + 1] - of.time[i]);
            average[c] -= slope[c] * (next - G) + (i == first ? earliest * slope[c] : 0.0);
        }
        G = next;
    }
    for (int c = 0; c < 3; c++) average[c] += (G - (of.time[last] - middle)) * slope[c];
    found.acceleration = std::isfinite(average[0]) && std::isfinite(average[1]) && std::isfinite(average[2]);
    if (found.acceleration) std::copy(average, average + 3, force);
    return found;
}

}  // namespace vip
