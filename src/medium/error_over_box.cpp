#include "medium/error_over_box.hpp"

#include "base/text.hpp"

#include <algorithm>

namespace flexgram {

ErrorOverBox::ErrorOverBox(std::vector<Sight> sights, RelativeTo relative_to)
    : relative_to_(relative_to) {
  for (Sight& sight : sights) add(std::move(sight));
}

void ErrorOverBox::add(Sight sight) {
  Part part{std::move(sight.values), sight.seen, {*sight.seen, relative_to_}, {}};
  const std::vector<PortView>& views =
      (parts_.empty() ? part : parts_.front()).seen->model().views;
  for (const PortView& view : part.seen->model().views) {
    const auto same =
        std::find_if(views.begin(), views.end(),
                     [&](const PortView& other) { return other.name == view.name; });
    if (same == views.end() || part.seen->model().views.size() != views.size())
      throw Error(text("H of some kind of ports vanishes with some values of the "
                       "parameters and not with others (see %s): leave one of its ports "
                       "out, or take {tol_of} whole",
                       view.name.c_str()));
    part.view.push_back(static_cast<std::size_t>(same - views.begin()));
  }
  parts_.push_back(std::move(part));
}

ErrorOverBox::Errors ErrorOverBox::of(const DenseSystem& small) {
  Errors all = parts_.front().errors.of(small.at(parts_.front().values));
  for (std::size_t k = 1; k < parts_.size(); ++k)
    all.worst =
        std::max(all.worst, parts_[k].errors.of(small.at(parts_[k].values)).worst);
  return all;
}

bool ErrorOverBox::meets(const DenseSystem& small, double tolerance, Measure measure) {
  for (std::size_t k = 0; k < parts_.size(); ++k) {
    const std::size_t at = (hard_ + k) % parts_.size(); // a failure is found early
    Part& part = parts_[at];
    if (part.errors.meets(small.at(part.values), tolerance, measure)) continue;
    hard_ = at;
    return false;
  }
  return true;
}

ErrorOverBox::Supremum ErrorOverBox::supremum(const DenseSystem& small, double level) {
  Supremum all;
  const std::size_t views = parts_.front().view.size();
  all.worst_of.assign(views, 0.0);
  all.attained_of.assign(views, 0.0);
  all.at_of.assign(views, 0.0);
  all.values_of.assign(views, parts_.front().values);
  for (Part& part : parts_) {
    const auto here = part.errors.supremum(small.at(part.values), level);
    for (std::size_t v = 0; v < part.view.size(); ++v) {
      const std::size_t view = part.view[v];
      all.worst_of[view] = std::max(all.worst_of[view], here.worst_of[v]);
      if (!(here.attained_of[v] > all.attained_of[view])) continue;
      all.attained_of[view] = here.attained_of[v];
      all.at_of[view] = here.at_of[v];
      all.values_of[view] = part.values;
    }
    all.proved = all.proved && here.proved;
    all.intervals += here.intervals;
    all.excluded.insert(all.excluded.end(), here.excluded.begin(), here.excluded.end());
  }
  all.worst = *std::max_element(all.worst_of.begin(), all.worst_of.end());
  all.excluded = joined(std::move(all.excluded));
  return all;
}

ErrorOverBand::Unmet ErrorOverBox::unmet(const DenseSystem& small, double tolerance) {
  ErrorOverBand::Unmet all;
  for (Part& part : parts_) {
    const auto here = part.errors.unmet(small.at(part.values), tolerance,
                                        1.0 / static_cast<double>(parts_.size()));
    all.share = std::max(all.share, here.share);
    all.intervals.insert(all.intervals.end(), here.intervals.begin(),
                         here.intervals.end());
  }
  all.intervals = joined(std::move(all.intervals));
  return all;
}

ErrorOverBand::Floor ErrorOverBox::largest_floor() {
  ErrorOverBand::Floor most;
  for (Part& part : parts_)
    if (const auto floor = part.errors.largest_floor(); floor.worst > most.worst)
      most = floor;
  return most;
}

double ErrorOverBox::least() {
  double least = 0;
  for (Part& part : parts_) least = std::max(least, part.errors.least());
  return least;
}

} // namespace flexgram
