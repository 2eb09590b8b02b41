#include "io/kept_rows.hpp"

#include "base/index.hpp"
#include "base/text.hpp"

#include <algorithm>
#include <cmath>
#include <list>
#include <numeric>

namespace flexgram {

void write_basis(Hdf5File& file, const std::string& name, const Basis& V, PetscInt n,
                 RowRange rows) {
  std::list<Block::Access> pieces;
  std::vector<const double*> column;
  for (const Block& piece : V.pieces()) {
    const Block::Access& access = pieces.emplace_back(piece);
    for (PetscInt j = 0; j < piece.columns(); ++j) column.push_back(access.column(j));
  }
  file.write_rows(name, n, V.columns(), rows, [&](RowRange part, double* to) {
    for (const double* from : column) {
      double* at = to++;
      for (PetscInt i = part.begin - rows.begin; i < part.end - rows.begin; ++i) {
        *at = from[i];
        at += column.size();
      }
    }
  });
}

Block read_basis(const Hdf5File& file, const std::string& name, PetscInt n,
                 RowRange rows) {
  std::int64_t columns = 0;
  agree(file.comm(), [&] {
    const auto shape = file.shape(name);
    if (shape.size() != 2 || shape[0] != n)
      throw Error(text("file %s: %s does not fit: it is damaged", file.path().c_str(),
                       name.c_str()));
    columns = shape[1];
  });
  Block V(file.comm(), rows, n, static_cast<PetscInt>(columns));
  agree(file.comm(), [&] {
    Block::Access access(V);
    for (const RowRange& part : batches_of(rows, columns)) {
      const auto values = file.read<double>(name, part.begin, part.size());
      for (PetscInt j = 0; j < V.columns(); ++j)
        for (PetscInt i = 0; i < part.size(); ++i)
          access.column(j)[part.begin - rows.begin + i] =
              values[as_size(i * V.columns() + j)];
    }
  });
  return V;
}

namespace {

/// Numbers that tell bodies apart.
std::vector<std::pair<std::string, double>> identity_of(const SecondOrderModel& body) {
  const auto norm = [&](Mat a) {
    PetscReal value = 0;
    if (a) FG_CALL(MatNorm(a, NORM_FROBENIUS, &value));
    return static_cast<double>(value);
  };
  const auto sense = [](Mat a) { // xᵀGy of two vectors: another sign is another body
    PetscScalar value = 0;
    if (!a) return static_cast<double>(value);
    Handle<Vec> x, y, z;
    FG_CALL(MatCreateVecs(a, x.out(), y.out()));
    FG_CALL(VecDuplicate(x, z.out()));
    PetscInt first = 0, last = 0;
    FG_CALL(VecGetOwnershipRange(x, &first, &last));
    for (PetscInt i = first; i < last; ++i) {
      FG_CALL(VecSetValue(x, i, std::sin(1.0 + static_cast<double>(i)), INSERT_VALUES));
      FG_CALL(VecSetValue(z, i, std::cos(1.7 * static_cast<double>(i)), INSERT_VALUES));
    }
    for (Vec v : {x.get(), z.get()}) {
      FG_CALL(VecAssemblyBegin(v));
      FG_CALL(VecAssemblyEnd(v));
    }
    FG_CALL(MatMult(a, x, y));
    FG_CALL(VecDot(z, y, &value));
    return static_cast<double>(value);
  };
  const auto size = [&](const Block& block) {
    double square = 0;
    {
      Block::Access access(block);
      for (double x : access.all()) square += x * x;
    }
    return std::sqrt(sum_over(body.comm, square));
  };
  std::vector<std::pair<std::string, double>> identity{
      {"n", static_cast<double>(body.n)},
      {"alpha", body.damping.alpha},
      {"beta", body.damping.beta},
      {"eta", body.damping.eta},
      {"norm of K", norm(body.K)},
      {"norm of M", norm(body.M)},
      {"norm of D", norm(body.term({}))},
      {"norm of B", size(body.B)},
      {"norm of C", size(body.C)},
      {"norm of S", norm(body.term(Law::Kind::structural))},
      {"norm of G", norm(body.term(Law::Kind::gyroscopic))},
      {"sense of G", sense(body.term(Law::Kind::gyroscopic))}};
  for (const auto& [law, T] : body.terms) {
    if (!law.is_named()) continue;
    identity.emplace_back("norm of " + law.name(), norm(T));
    if (law.is_skew()) identity.emplace_back("sense of " + law.name(), sense(T));
    for (const auto& [name, values] : law.kind().numbers()) {
      double sum = 0; // with weights of their own: their order tells
      for (std::size_t k = 0; k < values.size(); ++k)
        sum += std::sqrt(static_cast<double>(k + 2)) * values[k];
      identity.emplace_back(name + " of " + law.name(), sum);
    }
  }
  return identity;
}

} // namespace

void write_identity(Hdf5File& file, const SecondOrderModel& body) {
  file.create_group("/identity");
  for (const auto& [name, value] : identity_of(body))
    file.set_attribute("/identity", name, value);
  file.set_attribute("/identity", "inputs", body.inputs);
  file.set_attribute("/identity", "outputs", body.outputs);
}

void expect_identity(const Hdf5File& file, const SecondOrderModel& body) {
  const auto here = identity_of(body);
  agree(file.comm(), [&] {
    const auto refuse = [&](const std::string& why) {
      throw Error(text("{restart}: %s is of another job: %s; remove it to start afresh",
                       file.path().c_str(), why.c_str()));
    };
    for (const auto& [name, value] : here) {
      const double there = file.number_attribute("/identity", name);
      if (!(std::abs(there - value) <=
            1e-10 * std::max(std::abs(there), std::abs(value))))
        refuse(
            text("its body has %s = %.12g, this one %.12g", name.c_str(), there, value));
    }
    for (const auto& [name, ports] :
         {std::pair{"inputs", &body.inputs}, std::pair{"outputs", &body.outputs}}) {
      const auto there = file.texts_attribute("/identity", name);
      if (there != *ports)
        refuse(text("its %s are %s, here %s", name, join(there).c_str(),
                    join(*ports).c_str()));
    }
  });
}

namespace {

/// For each of this rank's rows its row in the file.
std::vector<PetscInt> rows_in(const Hdf5File& file, const SecondOrderModel& body) {
  const auto begin = as_size(body.rows.begin), count = as_size(body.rows.size());
  std::vector<PetscInt> rows(count);
  std::iota(rows.begin(), rows.end(), body.rows.begin);
  if (!file.exists("/dofs/node") || body.component.size() != count) return rows;
  const auto node = file.read_all<std::int64_t>("/dofs/node"),
             component = file.read_all<std::int64_t>("/dofs/component"),
             ids = file.read_all<std::int64_t>("/nodes/id");
  const auto n = as_size(body.n);
  const auto damaged = [&] {
    throw Error(text("file %s: /dofs does not fit: it is damaged", file.path().c_str()));
  };
  if (node.size() != n || component.size() != n) damaged();
  using Key = std::pair<std::int64_t, std::int64_t>;
  const auto there = [&](std::size_t row) -> Key {
    if (node[row] < 0 || as_size(node[row]) >= ids.size()) damaged();
    return {ids[as_size(node[row])], component[row]};
  };
  const auto here = [&](std::size_t i) -> Key {
    return {body.label.empty() ? body.node[i] : body.label[i], body.component[i]};
  };
  bool in_place = true;
  for (std::size_t i = 0; in_place && i < count; ++i)
    in_place = there(begin + i) == here(i);
  if (in_place) return rows;
  std::vector<std::pair<Key, PetscInt>> sorted;
  for (std::size_t row = 0; row < n; ++row)
    sorted.emplace_back(there(row), static_cast<PetscInt>(row));
  std::sort(sorted.begin(), sorted.end());
  for (std::size_t i = 0; i < count; ++i) {
    const auto found =
        std::lower_bound(sorted.begin(), sorted.end(), std::pair{here(i), PetscInt{0}});
    if (found == sorted.end() || found->first != here(i) ||
        (std::next(found) != sorted.end() && std::next(found)->first == here(i)))
      throw Error(text("{restart}: the checkpoint %s has not the nodes of this body",
                       file.path().c_str()));
    rows[i] = found->second;
  }
  return rows;
}

} // namespace

Block read_rows(const Hdf5File& file, const std::string& name,
                const SecondOrderModel& body) {
  std::vector<PetscInt> rows;
  agree(body.comm, [&] { rows = rows_in(file, body); });
  bool moved = false;
  for (std::size_t i = 0; i < rows.size(); ++i)
    moved = moved || rows[i] != body.rows.begin + static_cast<PetscInt>(i);
  if (sum_over(body.comm, static_cast<std::int64_t>(moved)) == 0)
    return read_basis(file, name, body.n, body.rows);
  std::int64_t columns = 0;
  agree(body.comm, [&] {
    const auto shape = file.shape(name);
    if (shape.size() != 2 || shape[0] != body.n || shape[1] < 1)
      throw Error(text("file %s: %s does not fit: it is damaged", file.path().c_str(),
                       name.c_str()));
    columns = shape[1];
  });
  Block V(body.comm, body.rows, body.n, static_cast<PetscInt>(columns));
  std::vector<std::pair<PetscInt, PetscInt>> wanted; // row of the file, row here
  for (std::size_t i = 0; i < rows.size(); ++i)
    wanted.emplace_back(rows[i], static_cast<PetscInt>(i));
  std::sort(wanted.begin(), wanted.end());
  agree(body.comm, [&] {
    Block::Access access(V);
    // Some megabytes at a time.
    const std::int64_t chunk = std::max<std::int64_t>(1, (8 << 20) / columns);
    std::size_t next = 0;
    for (std::int64_t first = 0; first < body.n && next < wanted.size(); first += chunk) {
      const std::int64_t last = std::min<std::int64_t>(first + chunk, body.n);
      if (wanted[next].first >= last) continue;
      const auto values = file.read<double>(name, first, last - first);
      for (; next < wanted.size() && wanted[next].first < last; ++next)
        for (PetscInt j = 0; j < V.columns(); ++j)
          access.column(j)[wanted[next].second] =
              values[as_size((wanted[next].first - first) * columns + j)];
    }
  });
  return V;
}

} // namespace flexgram
