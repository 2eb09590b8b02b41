/// Numbers side by side, in vectors as wide as those of the processor at hand.

#pragma once

#include <cstdint>

namespace flexgram {

/// `count` doubles in vectors of `native`. A compiler takes vectors that are wider than the processor's
/// apart, number by number.
template <int count, int native, bool fits = (count <= native)>
struct Lanes {
  typedef double Vector __attribute__((vector_size(count * sizeof(double)), aligned(8)));
  typedef std::int64_t Bits __attribute__((vector_size(count * sizeof(double))));
  Vector value{};

  [[gnu::always_inline]] void load(const double* x) {
    value = *reinterpret_cast<const Vector*>(x);
  }
  [[gnu::always_inline]] void store(double* x) const {
    *reinterpret_cast<Vector*>(x) = value;
  }
  [[gnu::always_inline]] void fill(double x) { value = Vector{} + x; }
  [[gnu::always_inline]] void keep(std::int64_t bits) {
    value = reinterpret_cast<Vector>(reinterpret_cast<Bits>(value) & bits);
  }
  [[gnu::always_inline]] void operator+=(const Lanes& x) { value += x.value; }
  [[gnu::always_inline]] void operator-=(const Lanes& x) { value -= x.value; }
  [[gnu::always_inline]] void operator*=(const Lanes& x) { value *= x.value; }
  [[gnu::always_inline]] void add_product(const Lanes& a, const Lanes& x) {
    value += a.value * x.value;
  }
};

template <int count, int native>
struct Lanes<count, native, false> {
  Lanes<native, native> first;
  Lanes<count - native, native> rest;

  [[gnu::always_inline]] void load(const double* x) {
    first.load(x);
    rest.load(x + native);
  }
  [[gnu::always_inline]] void store(double* x) const {
    first.store(x);
    rest.store(x + native);
  }
  [[gnu::always_inline]] void fill(double x) {
    first.fill(x);
    rest.fill(x);
  }
  [[gnu::always_inline]] void keep(std::int64_t bits) {
    first.keep(bits);
    rest.keep(bits);
  }
  [[gnu::always_inline]] void operator+=(const Lanes& x) {
    first += x.first;
    rest += x.rest;
  }
  [[gnu::always_inline]] void operator-=(const Lanes& x) {
    first -= x.first;
    rest -= x.rest;
  }
  [[gnu::always_inline]] void operator*=(const Lanes& x) {
    first *= x.first;
    rest *= x.rest;
  }
  [[gnu::always_inline]] void add_product(const Lanes& a, const Lanes& x) {
    first.add_product(a.first, x.first);
    rest.add_product(a.rest, x.rest);
  }
};

template <int count, int native>
[[gnu::always_inline]] inline Lanes<count, native>
operator+(Lanes<count, native> a, const Lanes<count, native>& b) {
  a += b;
  return a;
}
template <int count, int native>
[[gnu::always_inline]] inline Lanes<count, native>
operator-(Lanes<count, native> a, const Lanes<count, native>& b) {
  a -= b;
  return a;
}
template <int count, int native>
[[gnu::always_inline]] inline Lanes<count, native>
operator*(Lanes<count, native> a, const Lanes<count, native>& b) {
  a *= b;
  return a;
}

/// Eight sums of products side by side, with twice the digits: hi + lo, by Dekker's product and Knuth's
/// sum (Ogita, Rump, Oishi, 2005). Factors are split by their bits, which no contraction of the
/// compiler can undo.
inline constexpr int accurate_lanes = 8;
template <int native>
struct AccurateSum {
  static constexpr std::int64_t head = ~std::int64_t{0x7ffffff}; ///< 26 digits
  using Numbers = Lanes<accurate_lanes, native>;
  Numbers hi, lo, squares;

  [[gnu::always_inline]] void add(const Numbers& a, const Numbers& x) {
    Numbers a_head = a, x_head = x;
    a_head.keep(head);
    x_head.keep(head);
    const Numbers a_tail = a - a_head, x_tail = x - x_head, product = a * x;
    Numbers lost = a_head * x_head - product;
    lost.add_product(a_head, x_tail);
    lost.add_product(a_tail, x_head);
    lost.add_product(a_tail, x_tail);
    const Numbers sum = hi + product, of_product = sum - hi;
    lo += ((hi - (sum - of_product)) + (product - of_product)) + lost;
    hi = sum;
    squares.add_product(product, product);
  }
};

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
template <class Kernel, class... Arguments>
[[gnu::target("arch=x86-64-v4")]] void run_in_vectors_of_8(Arguments... arguments) {
  Kernel::template run<8>(arguments...);
}
template <class Kernel, class... Arguments>
[[gnu::target("arch=x86-64-v3")]] void run_in_vectors_of_4(Arguments... arguments) {
  Kernel::template run<4>(arguments...);
}
#endif

/// Kernel::run<native>(arguments), which must be inlined always, compiled for the processor at hand:
/// one binary serves every x86-64.
template <class Kernel, class... Arguments>
void run_on_processor(Arguments... arguments) {
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
  static const bool has_8 = __builtin_cpu_supports("x86-64-v4"),
                    has_4 = __builtin_cpu_supports("x86-64-v3");
  if (has_8) return run_in_vectors_of_8<Kernel>(arguments...);
  if (has_4) return run_in_vectors_of_4<Kernel>(arguments...);
#endif
  Kernel::template run<2>(arguments...);
}

} // namespace flexgram
