#include "base/text.hpp"

#include "base/index.hpp"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <set>

namespace flexgram {

std::string text(const char* format, ...) {
  va_list arguments, again;
  va_start(arguments, format);
  va_copy(again, arguments);
  const int length = std::vsnprintf(nullptr, 0, format, arguments);
  va_end(arguments);
  std::string result(as_size(std::max(length, 0)), '\0');
  std::vsnprintf(result.data(), result.size() + 1, format, again);
  va_end(again);
  return result;
}

namespace {

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::vector<std::size_t>> rows(a.size() + 1,
                                             std::vector<std::size_t>(b.size() + 1));
  for (std::size_t i = 0; i <= a.size(); ++i) rows[i][0] = i;
  for (std::size_t j = 0; j <= b.size(); ++j) rows[0][j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i)
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const bool same = a[i - 1] == b[j - 1];
      rows[i][j] = std::min(
          {rows[i - 1][j] + 1, rows[i][j - 1] + 1, rows[i - 1][j - 1] + (same ? 0 : 1)});
      const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (swapped) rows[i][j] = std::min(rows[i][j], rows[i - 2][j - 2] + 1);
    }
  return rows.back().back();
}

} // namespace

std::string nearest(std::string_view word, const std::vector<std::string>& candidates) {
  std::string best;
  std::size_t best_distance = std::string::npos;
  for (const auto& candidate : candidates) {
    const std::size_t distance = edit_distance(word, candidate);
    if (distance < best_distance) {
      best_distance = distance;
      best = candidate;
    }
  }
  return best;
}

std::string quoted(const std::string& path) {
  const std::string plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                            "0123456789._-+/,:@%=";
  if (path.find_first_not_of(plain) == std::string::npos) return path;
  std::string result = "'";
  for (char c : path)
    result += std::string_view("'")[0] == c ? "'\\''" : std::string(1, c);
  return result + "'";
}

std::string suggestion(const std::string& word,
                       const std::vector<std::string>& candidates) {
  const auto letters = [](const std::string& a) {
    return a.substr(std::min(a.find_first_not_of('-'), a.size()));
  };
  const std::string own = letters(word);
  std::string found;
  for (const std::string& candidate : candidates) { // the longest that is the beginning
    const std::string other = letters(candidate);
    const std::size_t common = std::min(own.size(), other.size());
    if (common >= 3 && own.compare(0, common, other, 0, common) == 0 &&
        (found.empty() || letters(found).size() < other.size()))
      found = candidate;
  }
  const std::string near = nearest(word, candidates);
  if (edit_distance(own, letters(near)) <= (own.size() < 6 ? 1 : 2)) found = near;
  return found.empty() ? "" : ": did you mean " + found + "?";
}

namespace {

std::set<std::string>& option_keys() {
  static std::set<std::string> keys;
  return keys;
}

OptionStyle& option_style() {
  static OptionStyle style = OptionStyle::command_line;
  return style;
}

/// A key, or one of a numbered family: mumps_cntl_1.
bool is_option_key(const std::string& key) {
  const std::size_t digits = key.find_last_not_of("0123456789") + 1;
  return option_keys().count(key) > 0 ||
         (digits < key.size() && option_keys().count(key.substr(0, digits) + "N") > 0);
}

} // namespace

void know_option(const std::string& name) {
  if (name.rfind("-mor_", 0) == 0) option_keys().insert(name.substr(5));
}

std::string short_name(std::string option) {
  if (option.rfind("-mor_", 0) == 0) option.erase(1, 4);
  if (option.size() > 3 && option.compare(option.size() - 3, 3, "_hz") == 0)
    option.erase(option.size() - 3);
  std::replace(option.begin(), option.end(), '_', '-');
  return "-" + option;
}

void set_option_style(OptionStyle style) { option_style() = style; }

std::string option_names(const std::string& message) {
  const std::string prefix = "-mor_";
  const auto told = [](const std::string& key) {
    if (option_style() == OptionStyle::command_line) return short_name("-mor_" + key);
    return key == "tol_relative_to" ? std::string("relative_to") : key;
  };
  std::string result;
  for (std::size_t i = 0; i < message.size(); ++i) {
    if (message[i] == '\\' && message.compare(i + 1, prefix.size(), prefix) == 0) {
      result += prefix; // as it is
      i += prefix.size();
      continue;
    }
    std::size_t begin = i, end = i, next = i;
    if (message[i] == '{' && message.find('}', i) != std::string::npos) {
      begin = i + 1;
      next = end = message.find('}', i);
    } else if (message.compare(i, prefix.size(), prefix) == 0) {
      begin = i + prefix.size();
      end = begin;
      while (
          end < message.size() &&
          (std::isalnum(static_cast<unsigned char>(message[end])) || message[end] == '_'))
        ++end;
      next = end - 1;
    }
    const std::string key = message.substr(begin, end - begin);
    if (end > begin && is_option_key(key)) {
      result += told(key);
      i = next;
    } else {
      result += message[i];
    }
  }
  return result;
}

std::string join(const std::vector<std::string>& words, std::string_view separator) {
  std::string result;
  for (const auto& word : words) {
    if (!result.empty()) result += separator;
    result += word;
  }
  return result;
}

std::vector<std::string> split(std::string_view line, char separator) {
  std::vector<std::string> parts;
  for (std::size_t begin = 0; begin <= line.size();) {
    const std::size_t end = std::min(line.find(separator, begin), line.size());
    std::string_view part = line.substr(begin, end - begin);
    while (!part.empty() && part.front() == ' ') part.remove_prefix(1);
    while (!part.empty() && part.back() == ' ') part.remove_suffix(1);
    if (!part.empty()) parts.emplace_back(part);
    begin = end + 1;
  }
  return parts;
}

} // namespace flexgram
