/// Products of vectors in space.
#pragma once

#include "base/index.hpp"
#include "fem/elements.hpp"

namespace flexgram {

inline Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
          a[0] * b[1] - a[1] * b[0]};
}

inline double dot(const Vector3& a, const Vector3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/// [a ×]
inline Dense cross_matrix(const Vector3& a) {
  Dense A(3, 3);
  for (int i = 0; i < 3; ++i) {
    const int next = (i + 1) % 3, last = (i + 2) % 3;
    A(next, last) = -a[as_size(i)];
    A(last, next) = a[as_size(i)];
  }
  return A;
}

} // namespace flexgram
