#pragma once

#include <cmath>
#include <functional>
#include <vector>

namespace flexgram {

/// f(x) and its gradient, written to the second argument.
using Objective =
    std::function<double(const std::vector<double>& x, std::vector<double>& gradient)>;

struct LbfgsOptions {
  int iterations = 250;
  int history = 30;
  double enough = -HUGE_VAL; ///< ends when f is no larger than this
  double decrease = 1e-7;    ///< ends when ten steps lower f by less than ten times this
};

/// Minimises f from x by L-BFGS with steps that satisfy Wolfe's conditions (Nocedal,
/// Wright: Numerical Optimization, algorithms 7.5 and 3.5). x becomes the best point
/// found. @return f there.
double minimise(const Objective& f, std::vector<double>& x, const LbfgsOptions& options);

} // namespace flexgram
