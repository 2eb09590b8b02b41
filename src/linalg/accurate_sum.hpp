/// Eight sums of products side by side, with twice the digits.

#pragma once

#include <cstdint>

// One binary for every x86-64: the loader picks the version that the processor has.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define FLEXGRAM_FOR_EACH_PROCESSOR                                                      \
  __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define FLEXGRAM_FOR_EACH_PROCESSOR
#endif

namespace flexgram {

/// Sums of products hi + lo, by Dekker's product and Knuth's sum (Ogita, Rump, Oishi, 2005).
/// Factors are split by their bits, which no contraction of the compiler can undo.
struct AccurateSum {
  static constexpr int lanes = 8;
  typedef double Doubles __attribute__((vector_size(lanes * sizeof(double)), aligned(8)));
  typedef std::int64_t Bits __attribute__((vector_size(sizeof(Doubles))));

  [[gnu::always_inline]] void add(const Doubles& a, const Doubles& x) {
    const Doubles product = a * x,
                  a_head = reinterpret_cast<Doubles>(reinterpret_cast<Bits>(a) & head),
                  x_head = reinterpret_cast<Doubles>(reinterpret_cast<Bits>(x) & head),
                  a_tail = a - a_head, x_tail = x - x_head,
                  lost =
                      ((a_head * x_head - product) + a_head * x_tail + a_tail * x_head) +
                      a_tail * x_tail,
                  sum = hi + product, of_product = sum - hi;
    lo += ((hi - (sum - of_product)) + (product - of_product)) + lost;
    hi = sum;
    squares += product * product;
  }
  static constexpr std::int64_t head = ~std::int64_t{0x7ffffff}; ///< 26 digits
  Doubles hi{}, lo{}, squares{};
};

} // namespace flexgram
