// Messages as JSON: the fields of the .lcm files, the numbers of the messages, as their schemas say.
#include "tools/logs/message_json.h"

#include <cmath>
#include <set>
#include <sstream>

#include "tests/support/harness.h"
#include "tests/support/json_schema.h"
#include "tests/support/random_messages.h"

namespace swarm::test {
namespace {

using namespace random_messages;
using Json = nlohmann::ordered_json;

// Names of the fields of a type, from its .lcm file.
std::vector<std::string> field_names(const std::string& type) {
  std::istringstream in(read_text(std::string(SWARM_SOURCE_DIR "/lcmtypes/") + type + ".lcm"));
  std::vector<std::string> names;
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line.substr(0, line.find("//")));
    std::string first, name;
    if (!(words >> first >> name) || first == "package" || first == "struct" || first == "const") continue;
    names.push_back(name.substr(0, name.find_first_of("[;")));
  }
  return names;
}

std::vector<std::string> keys(const Json& object) {
  std::vector<std::string> names;
  for (const auto& [name, value] : object.items()) names.push_back(name);
  return names;
}

void numbers_of(const Json& json, std::multiset<double>* numbers, int* nulls) {
  if (json.is_number()) numbers->insert(json.get<double>());
  if (json.is_null()) ++*nulls;
  if (!json.is_structured()) return;
  for (const auto& element : json) numbers_of(element, numbers, nulls);
}

template <class T>
class MessageJson : public ::testing::Test {};
TYPED_TEST_SUITE(MessageJson, AllTypes);

TYPED_TEST(MessageJson, HasTheFieldsOfTheLcmFile) {
  random_messages::Random random(1);
  std::vector<std::string> names = field_names(TypeParam::getTypeName());
  ASSERT_GE(names.size(), 1u);
  if (std::is_same_v<TypeParam, sogm_t> || std::is_same_v<TypeParam, packed_announcement_t> ||
      std::is_same_v<TypeParam, last_words_t> || std::is_same_v<TypeParam, cell_announcement_t> ||
      std::is_same_v<TypeParam, cell_roster_t>)
    names.pop_back();  // its bytes
  EXPECT_EQ(keys(to_json(make<TypeParam>(random, 3))), names);
  EXPECT_EQ(keys(to_json(make<TypeParam>(random, 3))["header"]), field_names("header_t"));
}

TYPED_TEST(MessageJson, HasTheNumbersAndFitsItsSchema) {
  random_messages::Random random(2);
  const Json schema = json_schema<TypeParam>();
  EXPECT_EQ(schema.at("title"), schema_name<TypeParam>());
  EXPECT_EQ(unreadable(schema), "");
  EXPECT_EQ(schema_name<TypeParam>(), std::string("sogm_swarm.") + TypeParam::getTypeName());
  for (const int elements : {0, 1, 7, 40}) {
    TypeParam message = make<TypeParam>(random, elements);
    const Json json = Json::parse(to_json(message).dump());
    EXPECT_EQ(misfit(schema, json), "");
    EXPECT_EQ(json["header"]["robot_id"], message.header.robot_id);
    EXPECT_EQ(json["header"]["utime"], message.header.utime);
    EXPECT_EQ(json["header"]["seq"], message.header.seq);
    std::multiset<double> numbers;
    int nulls = 0;
    numbers_of(json, &numbers, &nulls);
    EXPECT_EQ(nulls, 0);
    each_real(message, [&](auto value) {
      if (value == 0) return;
      // A float is the nearest one to the number that stands for it.
      const auto at = numbers.lower_bound(static_cast<double>(value) - 1e-6 * std::abs(static_cast<double>(value)));
      const bool found =
          std::any_of(at, numbers.end(), [&](double number) { return static_cast<decltype(value)>(number) == value; });
      EXPECT_TRUE(found) << value << " is missing";
    });
  }
}

TYPED_TEST(MessageJson, NumbersThatAreNotFiniteAreNull) {
  random_messages::Random random(3);
  TypeParam message = make<TypeParam>(random, 2);
  int reals = 0;
  each_real(message, [&](auto& value) {
    value = ++reals % 2 == 0 ? std::numeric_limits<double>::infinity() : std::numeric_limits<double>::quiet_NaN();
  });
  std::multiset<double> numbers;
  int nulls = 0;
  numbers_of(Json::parse(to_json(message).dump()), &numbers, &nulls);
  EXPECT_EQ(nulls > 0, reals > 0);
  for (const double number : numbers) EXPECT_EQ(number, std::floor(number));
}

TEST(MessageJsonOf, FloatsAreShort) {
  announcement_t message{};
  message.radius = 0.1f;
  EXPECT_EQ(to_json(message)["radius"].dump(), "0.1");
}

TEST(MessageJsonOf, TrajectoriesHaveTheKnotsThatSaySomething) {
  random_messages::Random random(4);
  announcement_t message{};
  message.committed = make_trajectory(random, 1000);
  message.committed.num_pieces = 3;
  const Json json = to_json(message);
  EXPECT_EQ(json["pending"]["knots"], Json::array());
  const Json& knots = json["committed"]["knots"];
  ASSERT_EQ(knots.size(), 4u);
  EXPECT_EQ(keys(knots[2]), (std::vector<std::string>{"x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az"}));
  EXPECT_EQ(knots[2]["vy"].get<float>(), message.committed.knots[2][4]);
  EXPECT_EQ(knots[3]["az"].get<float>(), message.committed.knots[3][8]);
}

TEST(MessageJsonOf, VoxelsAndElementsAreObjects) {
  random_messages::Random random(5);
  auto voxels = make<obstacle_voxels_t>(random, 2);
  voxels.voxels[1] = {-3, 4, 5};
  EXPECT_EQ(to_json(voxels)["voxels"][1].dump(), R"({"x":-3,"y":4,"z":5})");
  EXPECT_EQ(keys(to_json(make<corridors_t>(random, 1))["faces"][0]), field_names("face_t"));
  EXPECT_EQ(keys(to_json(make<obstacles_t>(random, 1))["obstacles"][0]), field_names("obstacle_t"));
  EXPECT_EQ(keys(to_json(make<announcement_t>(random, 1))["acks"][0]), field_names("ack_t"));
  EXPECT_EQ(keys(to_json(make<candidate_t>(random, 1))["trajectory"]), field_names("trajectory_t"));
}

}  // namespace
}  // namespace swarm::test
