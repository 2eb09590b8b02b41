#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace flexgram {

/// printf into a string (g++ 12 has no std::format).
[[gnu::format(printf, 1, 2)]] std::string text(const char* format, ...);

/// The candidate with the smallest edit distance to `word`; empty if there are none.
std::string nearest(std::string_view word, const std::vector<std::string>& candidates);

/// A file's name as a shell takes it.
std::string quoted(const std::string& path);

/// ": did you mean NEAREST?", if one is near: a few letters away, or one begins with the other.
std::string suggestion(const std::string& word,
                       const std::vector<std::string>& candidates);

/// "a, b, c"
std::string join(const std::vector<std::string>& words,
                 std::string_view separator = ", ");

/// Splits at `separator`, drops empty parts and surrounding blanks.
std::vector<std::string> split(std::string_view line, char separator);

/// "--band" of "-mor_band_hz": an option in the short words of the command line.
std::string short_name(std::string option);
/// How texts name options: --band, or band_hz as Python's keyword.
enum class OptionStyle { command_line, keyword };
void set_option_style(OptionStyle style);
/// "{tol} is not met" or "-mor_tol is not met" → "--tol is not met": the mathematics names what
/// a user can set by its key, and the texts that leave the program by the option. Braces around
/// anything else, such as a part of a file's name, stay; "\\-mor_tol" becomes "-mor_tol".
std::string option_names(const std::string& message);
/// "-mor_tol": the registry tells every option that there is.
void know_option(const std::string& name);

} // namespace flexgram
