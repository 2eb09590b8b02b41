#include "base/command_line.hpp"
#include "base/index.hpp"
#include "base/options.hpp"
#include "base/text.hpp"
#include "examples.hpp"

using namespace flexgram;
using examples::world;

namespace {

/// Sets PETSc options for one test.
class WithOptions {
public:
  explicit WithOptions(const char* words) { PetscOptionsInsertString(nullptr, words); }
  ~WithOptions() { PetscOptionsClear(nullptr); }
};

std::string message_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

} // namespace

TEST(Base, NearestWordHasTheSmallestEditDistance) {
  EXPECT_EQ(nearest("-mor_sampels", {"-mor_out", "-mor_samples", "-mor_svd"}),
            "-mor_samples");
  EXPECT_EQ(nearest("x", {}), "");
}

TEST(Base, SplitDropsBlanksAndEmptyParts) {
  EXPECT_EQ(split(" a, b,,c ", ','), (std::vector<std::string>{"a", "b", "c"}));
  EXPECT_TRUE(split("", ',').empty());
}

TEST(Base, OptionsReadEveryKindAndKeepDefaults) {
  const WithOptions set("-mor_x 2.5 -mor_n 7 -mor_flag -mor_list 1,2.5 -mor_c two "
                        "-mor_mumps_icntl_14 60");
  Options options;
  double x = 1, y = 3;
  int n = 1;
  bool flag = false;
  std::vector<double> list;
  std::string c = "one";
  std::map<int, double> icntl;
  options.add("-mor_x", x, "m", "");
  options.add("-mor_y", y, "m", "");
  options.add("-mor_n", n, "", "");
  options.add("-mor_flag", flag, "");
  options.add("-mor_list", list, "", "");
  options.add_choice("-mor_c", c, {"one", "two"}, "");
  options.add_numbered("-mor_mumps_icntl_", icntl, "");
  EXPECT_EQ(x, 2.5);
  EXPECT_EQ(y, 3);
  EXPECT_EQ(n, 7);
  EXPECT_TRUE(flag);
  EXPECT_EQ(list, (std::vector<double>{1, 2.5}));
  EXPECT_EQ(c, "two");
  EXPECT_EQ(icntl.at(14), 60);
  EXPECT_NO_THROW(options.reject_unknown());
  EXPECT_TRUE(options.all().front().set_by_user);
  EXPECT_FALSE(options.all()[1].set_by_user);
}

TEST(Base, OptionsRejectWhatTheyDoNotKnow) {
  const WithOptions set("-mor_sampels 3 -mor_n 1.5 -mor_x nan -mor_c tow");
  Options options;
  int n = 1;
  double x = 0;
  std::string c = "one";
  EXPECT_NE(message_of([&] { options.add("-mor_n", n, "", ""); }).find("whole number"),
            std::string::npos);
  EXPECT_NE(message_of([&] { options.add("-mor_x", x, "", ""); }).find("finite"),
            std::string::npos);
  EXPECT_NE(message_of([&] {
              options.add_choice("-mor_c", c, {"one", "two"}, "");
            }).find("did you mean two"),
            std::string::npos);
  int samples = 1;
  options.add("-mor_samples", samples, "", "");
  EXPECT_NE(message_of([&] { options.reject_unknown(); }).find("-mor_samples"),
            std::string::npos);
}

TEST(Base, AFailureOnOneRankIsThrownOnAll) {
  const int last = comm_size(world()) - 1;
  const std::string message = message_of([&] {
    agree(world(), [&] {
      if (comm_rank(world()) == last) throw Error(text("only rank %d", last));
    });
  });
  EXPECT_EQ(message, text("only rank %d", last));
}

TEST(Base, PetscErrorsBecomeExceptionsWithPetscsText) {
  Matrix matrix;
  FG_CALL(MatCreate(world(), matrix.out()));
  const std::string message =
      message_of([&] { FG_CALL(MatSetType(matrix, "nonsense")); });
  EXPECT_NE(message.find("MatSetType"), std::string::npos);
  EXPECT_NE(message.find("nonsense"), std::string::npos);
}

TEST(Base, ExchangeRowsMovesEveryRowHome) {
  // Every rank offers its rows of two columns and wants all of them in reverse order of
  // ranks.
  const PetscInt n = 11;
  const RowRange mine = even_rows(world(), n);
  std::vector<double> values;
  for (int column = 0; column < 2; ++column)
    for (PetscInt i = mine.begin; i < mine.end; ++i)
      values.push_back(100 * column + static_cast<double>(i));
  const int size = comm_size(world()), mirrored = size - 1 - comm_rank(world());
  const RowRange wanted{n * mirrored / size, n * (mirrored + 1) / size};
  const auto result = exchange_rows<double>(world(), mine, values, 2, 0, wanted, 2);
  for (int column = 0; column < 2; ++column)
    for (PetscInt i = 0; i < wanted.size(); ++i)
      EXPECT_EQ(result[as_size(i + column * wanted.size())],
                100 * column + static_cast<double>(wanted.begin + i));
}

TEST(Base, GroupsSplitTheWorldEvenly) {
  const Groups groups(world(), comm_size(world()));
  EXPECT_EQ(comm_size(groups.comm), 1);
  EXPECT_EQ(groups.mine, comm_rank(world()));
  EXPECT_THROW(Groups(world(), comm_size(world()) + 1), Error);
}

TEST(Base, MessagesNameOptionsAndLeaveOtherBracesAlone) {
  know_option("-mor_tol");
  know_option("-mor_mumps_cntl_N");
  EXPECT_EQ(option_names("{tol} 1 in part{left}.h5, {mumps_cntl_1} {tol"),
            "--tol 1 in part{left}.h5, --mumps-cntl-1 {tol");
  EXPECT_EQ(option_names("(-mor_tol), -mor_tolerant"), "(--tol), -mor_tolerant");
  set_option_style(OptionStyle::keyword);
  EXPECT_EQ(option_names("{tol} or -mor_tol"), "tol or tol");
  set_option_style(OptionStyle::command_line);
}

TEST(Base, SuggestionsAreNearOrNone) {
  const std::vector<std::string> known{"--tol", "--tol-of", "--band", "--body"};
  EXPECT_EQ(suggestion("--tolerance", known), ": did you mean --tol?");
  EXPECT_EQ(suggestion("--bnd", known), ": did you mean --band?");
  EXPECT_EQ(suggestion("--bnad", known), ": did you mean --band?"); // two letters swapped
  EXPECT_EQ(suggestion("--tol_of", known), ": did you mean --tol-of?");
  EXPECT_EQ(suggestion("--wobble", known), "");
  EXPECT_EQ(quoted("out/a b.h5"), "'out/a b.h5'");
  EXPECT_EQ(quoted("it's"), "'it'\\''s'");
  EXPECT_EQ(quoted("out/a.h5"), "out/a.h5");
}

TEST(Base, ShortWordsBecomePetscs) {
  std::vector<Option> options(5);
  options[0].name = "-body";
  options[1].name = "-mor_band_hz";
  options[2].name = "-mor_field_error";
  options[2].type = "choice";
  options[2].choices = "no|yes";
  options[3].name = "-mor_mumps_icntl_N";
  options[3].type = "numbered";
  for (Option& option : options) option.verbs = "reduce plan";
  options[4].name = "-mor_sweep_hz";
  options[4].verbs = "sweep";
  using Words = std::vector<std::string>;
  const auto become = [&](const Words& words) {
    return petsc_words(words, options, {"reduce", {"-body", "-rom"}, "-mor_out"});
  };
  EXPECT_EQ(become({"a.h5", "--band", "-1,2", "-o", "b.h5"}),
            (Words{"-body", "a.h5", "-mor_band_hz", "-1,2", "-mor_out", "b.h5"}));
  EXPECT_EQ(become({"--field-error", "a.h5", "b.h5", "-vv"}),
            (Words{"-mor_field_error", "yes", "-body", "a.h5", "-rom", "b.h5",
                   "-mor_monitor", "detail"}));
  EXPECT_EQ(
      become({"--field-error", "no", "--mumps-icntl-14=30", "-log_view", ":x"}),
      (Words{"-mor_field_error", "no", "-mor_mumps_icntl_14", "30", "-log_view", ":x"}));
  EXPECT_EQ(become({"-body", "a.h5", "b.h5"}), (Words{"-body", "a.h5", "-rom", "b.h5"}));
  EXPECT_EQ(become({"--band_hz=1"}), (Words{"-mor_band_hz", "1"}));
  EXPECT_EQ(become({"-o=a", "-v"}), (Words{"-mor_out", "a", "-mor_monitor", "plan"}));
  for (const Words& wrong :
       {Words{"--bnd", "1"}, Words{"--band"}, Words{"--band", "-o"}, Words{"-o"},
        Words{"a", "b", "c"}, Words{"--sweep", "1"}, Words{"--band", "1", "--band", "2"}})
    EXPECT_THROW(become(wrong), Error);
}
