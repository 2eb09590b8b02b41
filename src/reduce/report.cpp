#include "reduce/report.hpp"

#include "base/text.hpp"
#include "reduce/project.hpp"

#include <algorithm>
#include <numbers>

namespace flexgram {
namespace {

/// Rows (or columns) of the ports of one kind, by the names' last part: "f" forces, "m"
/// moments.
std::vector<int> ports_of_kind(const std::vector<std::string>& names, char kind) {
  std::vector<int> found;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto dot = names[i].rfind('.');
    if (dot != std::string::npos && names[i].size() == dot + 3 &&
        names[i][dot + 1] == kind)
      found.push_back(static_cast<int>(i));
  }
  return found;
}

ComplexDense part_of(const ComplexDense& h, const std::vector<int>& rows,
                     const std::vector<int>& columns) {
  ComplexDense part(static_cast<int>(rows.size()), static_cast<int>(columns.size()));
  for (int j = 0; j < part.columns; ++j)
    for (int i = 0; i < part.rows; ++i)
      part(i, j) =
          h(rows[static_cast<std::size_t>(i)], columns[static_cast<std::size_t>(j)]);
  return part;
}

} // namespace

double error_of_kind(const SecondOrderModel& names, const std::vector<ComplexDense>& H,
                     const std::vector<ComplexDense>& H_r, char kind) {
  const auto rows = ports_of_kind(names.outputs, kind);
  const auto columns = ports_of_kind(names.inputs, kind);
  double worst = -1;
  if (!rows.empty() && !columns.empty())
    for (std::size_t l = 0; l < H.size(); ++l)
      worst = std::max(worst, relative_error(part_of(H[l], rows, columns),
                                             part_of(H_r[l], rows, columns)));
  return worst;
}

std::string describe_modes(const std::vector<double>& modes, int rigid) {
  const double hz = 0.5 / std::numbers::pi;
  const auto count = static_cast<std::size_t>(rigid);
  if (modes.empty()) return "not known, the reduced M is singular";
  std::string words;
  if (count > 0 && count <= modes.size())
    words = text("%d rigid, up to %.2g Hz, ", rigid, modes[count - 1] * hz);
  if (count < modes.size()) words += text("elastic from %.4g Hz", modes[count] * hz);
  return words;
}

} // namespace flexgram
