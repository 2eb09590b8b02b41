#include "run/sweep.hpp"

#include "base/index.hpp"
#include "base/parallel.hpp"
#include "base/text.hpp"
#include "io/hdf5_file.hpp"
#include "io/reduced_io.hpp"
#include "model/port_views.hpp"
#include "model/project.hpp"
#include "run/summary.hpp"

#include <algorithm>

namespace flexgram {

void plan_solves(const FrequencySolves& solves, std::size_t tasks, Observer& observer) {
  const FactorEstimate& e = solves.estimate();
  observer.fact("factorisation",
                text("%s %s, %.2g entries, %.2g flops, %.0f MB on a rank, ordered by %s",
                     solves.model().undamped()            ? "real"
                     : is_symmetric(solves.model().terms) ? "complex symmetric"
                                                          : "complex",
                     is_symmetric(solves.model().terms) ? "LDLᵀ" : "LU", e.factor_entries,
                     e.flops, e.mb_per_rank, solves.ordering().c_str()));
  observer.fact("parallel",
                text("%zu frequencies over %d group%s of %d rank%s", tasks,
                     solves.groups().count, solves.groups().count == 1 ? "" : "s",
                     comm_size(solves.groups().comm),
                     comm_size(solves.groups().comm) == 1 ? "" : "s"));
}

namespace {

std::vector<double> sweep_omega(const std::vector<double>& list) {
  std::string words;
  for (double f : list) words += text("%s%g", words.empty() ? "" : ",", f);
  require_option(list.size() == 1 || (list.size() == 3 && list[2] >= 1), "-mor_sweep_hz",
                 words, "first,last,count or one frequency");
  require_option(list[0] >= 0, "-mor_sweep_hz", words, "zero or more");
  require_option(list.size() == 1 || list[0] <= list[1], "-mor_sweep_hz", words,
                 "first,last,count with first <= last");
  if (list.size() == 1) return {list[0] / hz};
  const int count = static_cast<int>(list[2]);
  std::vector<double> omega;
  for (int l = 0; l < count; ++l)
    omega.push_back(
        (list[0] + (count == 1 ? 0.0 : (list[1] - list[0]) * l / (count - 1))) / hz);
  return omega;
}

void write_sweep(MPI_Comm comm, const Settings& s, const std::vector<double>& omega,
                 const std::vector<ComplexDense>& H,
                 const std::vector<ComplexDense>& H_rom,
                 const std::vector<double>& epsilon, const SecondOrderModel& model,
                 const Options& options) {
  Hdf5File file = Hdf5File::create(comm, s.sweep_out);
  file.write("/omega", {static_cast<std::int64_t>(omega.size())}, omega);
  const auto write_transfer = [&](const char* name,
                                  const std::vector<ComplexDense>& list) {
    std::vector<double> values;
    for (const auto& h : list)
      for (int i = 0; i < h.rows; ++i)
        for (int j = 0; j < h.columns; ++j) {
          values.push_back(h(i, j).real());
          values.push_back(h(i, j).imag());
        }
    file.write(name,
               {static_cast<std::int64_t>(omega.size()), model.C.columns(),
                model.B.columns(), 2},
               values);
    file.set_attribute(name, "inputs", model.inputs);
    file.set_attribute(name, "outputs", model.outputs);
  };
  write_transfer("/H", H);
  if (!H_rom.empty()) {
    write_transfer("/H_rom", H_rom);
    file.write("/error/relative", {static_cast<std::int64_t>(epsilon.size())}, epsilon);
  }
  write_options(file, options);
  file.commit();
}

/// A reduced file knows how many rows its basis has, which are those of its body.
void expect_its_body(MPI_Comm comm, const Settings& s, std::int64_t n,
                     Observer& observer) {
  std::int64_t rows = n;
  {
    const Hdf5File file = Hdf5File::open(comm, s.rom);
    agree(comm, [&] {
      if (file.exists("/V")) rows = file.shape("/V").front();
    });
  }
  if (rows != n)
    observer.warn(
        text("%s was reduced from a body with %lld dofs, and %s has %lld: is it "
             "that body?",
             s.rom.c_str(), static_cast<long long>(rows), s.body.c_str(),
             static_cast<long long>(n)));
}

/// Kinds of responses of which a reduced body's claim is, by name.
std::vector<std::string> claimed_kinds(MPI_Comm comm, const std::string& rom) {
  std::vector<std::string> kinds;
  const Hdf5File file = Hdf5File::open(comm, rom);
  agree(comm, [&] {
    if (file.exists("/error") && file.has_attribute("/error", "kinds"))
      kinds = file.texts_attribute("/error", "kinds");
  });
  return kinds;
}

/// "displacement from force 7.8e-04 at 812 Hz, …": the largest relative error of each.
std::string errors_by_kind(const SecondOrderModel& rom,
                           const std::vector<std::string>& kinds,
                           const std::vector<double>& omega,
                           const std::vector<ComplexDense>& H,
                           const std::vector<ComplexDense>& H_rom) {
  std::vector<std::string> words;
  KindSpec each;
  each.each = true;
  for (const PortView& view : port_views(rom, each)) {
    if (std::find(kinds.begin(), kinds.end(), view.name) == kinds.end()) continue;
    double worst = -1, at = 0;
    for (std::size_t l = 0; l < omega.size(); ++l) {
      const double error = relative_error(view.of(H[l]), view.of(H_rom[l]));
      if (error > worst) {
        worst = error;
        at = omega[l];
      }
    }
    words.push_back(text("%s %.2e at %.4g Hz", view.name.c_str(), worst, at * hz));
  }
  return join(words);
}

} // namespace

void sweep(MPI_Comm comm, const Settings& s, const Options& options, Observer& observer) {
  const std::vector<double> omega = sweep_omega(s.sweep_hz);
  check_output(comm, s.sweep_out, {s.body, s.rom});
  check_default_output(comm, s.sweep_out, options, "-mor_sweep_out", "/omega");
  Body body = load_body(comm, s, observer);
  SecondOrderModel rom;
  if (!s.rom.empty()) {
    rom = read_reduced(comm, s.rom);
    expect_its_body(comm, s, body.model.n, observer);
    const bool chosen = !s.inputs.empty() || !s.outputs.empty();
    SecondOrderModel& fewer =
        chosen ? rom : body.model; // without a choice the rom's ports count
    const SecondOrderModel& wanted = chosen ? body.model : rom;
    with_context("comparing " + s.rom + " with " + s.body,
                 [&] { select_ports(fewer, wanted.inputs, wanted.outputs); });
  }
  FrequencySolves solves(std::move(body.model), s.groups, s.solver,
                         static_cast<int>(omega.size()), 0.0, observer);
  plan_solves(solves, omega.size(), observer);
  observer.print();
  std::vector<ComplexDense> H, H_rom;
  {
    Stage stage(observer, "sweep");
    H = solves.transfer(omega, "frequency");
  }
  std::vector<double> epsilon;
  if (rom.n > 0) {
    for (std::size_t l = 0; l < omega.size(); ++l) {
      H_rom.push_back(dense_transfer(rom, omega[l]));
      epsilon.push_back(relative_error(H[l], H_rom.back()));
    }
    const auto worst = std::max_element(epsilon.begin(), epsilon.end());
    const std::string words =
        text("at most %.2e at %zu frequencies, largest at %.4g Hz", *worst, omega.size(),
             omega[as_size(worst - epsilon.begin())] * hz);
    observer.fact("error", words);
    const std::string by_kind =
        errors_by_kind(rom, claimed_kinds(comm, s.rom), omega, H, H_rom);
    if (!by_kind.empty()) observer.fact("by kind", by_kind);
    if (observer.level() == Observer::Level::summary) {
      observer.say("Relative error of H " + words + ".");
      if (!by_kind.empty()) observer.say("  Of each kind of responses: " + by_kind + ".");
    }
  }
  observer.fact("solves", text("%d factorisations, backward error at most %.0e",
                               solves.factorisations(), solves.worst_backward_error()));
  observer.print();
  {
    Stage stage(observer, "write");
    write_sweep(comm, s, omega, H, H_rom, epsilon, solves.model(), options);
  }
  say_time(observer, comm);
  observer.say("  wrote          " + s.sweep_out);
}

} // namespace flexgram
