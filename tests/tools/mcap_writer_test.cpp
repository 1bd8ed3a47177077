// MCAP files: what is read back by the specification is what was written, and a file is whole or not there.
#include "tools/logs/mcap_writer.h"

#include <random>

#include "tests/support/mcap_reader.h"

namespace swarm::test {
namespace {

namespace fs = std::filesystem;

TEST(McapWriter, WritesWhatReadsBack) {
  for (const bool compress : {false, true}) {
    SCOPED_TRACE(compress);
    const TemporaryDirectory directory;
    const fs::path path = directory / "log.mcap";
    std::mt19937_64 random(2);
    McapWriter writer(path, "a program", {.compress = compress, .chunk_bytes = 5000});
    std::vector<McapMessage> written;
    std::map<std::uint16_t, std::uint32_t> counts;
    std::vector<std::uint16_t> channels;
    for (int i = 0; i < 2000; ++i) {
      if (i % 500 == 0) {
        const std::uint16_t schema =
            writer.add_schema("thing" + std::to_string(i), "jsonschema", R"({"type":"object"})");
        for (const char* topic : {"/a", "/b/c"})
          channels.push_back(writer.add_channel(schema, topic + std::to_string(i), "json"));
      }
      const std::uint16_t channel = channels[random() % channels.size()];
      const std::uint64_t time_ns = 1'700'000'000'000'000'000 + 1000 * i - random() % 5000;  // not quite in order
      const std::string data(i % 100 == 0 ? 20'000 : random() % 60, static_cast<char>('a' + i % 26));
      writer.write(channel, time_ns, data);
      written.push_back({channel, counts[channel]++, time_ns, data});
    }
    EXPECT_EQ(writer.messages(), 2000u);
    EXPECT_EQ(writer.channels(), 8u);
    EXPECT_FALSE(fs::exists(path)) << "before it is closed";
    writer.close();
    EXPECT_EQ(writer.bytes(), fs::file_size(path));
    const McapFile file = McapReader::read(path);
    EXPECT_EQ(file.library, "a program");
    EXPECT_EQ(file.compression, compress ? "zstd" : "");
    EXPECT_GT(file.chunks, 20);
    EXPECT_EQ(file.schemas.size(), 4u);
    EXPECT_EQ(file.schemas.at(2).name, "thing500");
    EXPECT_EQ(file.schemas.at(2).encoding, "jsonschema");
    EXPECT_EQ(file.channels.at(3).topic, "/a500");
    EXPECT_EQ(file.channels.at(3).schema, 2);
    EXPECT_EQ(file.channels.at(3).encoding, "json");
    ASSERT_EQ(file.messages.size(), written.size());
    for (std::size_t i = 0; i < written.size(); ++i) {
      EXPECT_EQ(file.messages[i].channel, written[i].channel);
      EXPECT_EQ(file.messages[i].time_ns, written[i].time_ns);
      EXPECT_EQ(file.messages[i].data, written[i].data);
    }
  }
}

TEST(McapWriter, FilesWithoutMessagesAreWhole) {
  const TemporaryDirectory directory;
  McapWriter(directory / "nothing.mcap", "p").close();
  EXPECT_TRUE(McapReader::read(directory / "nothing.mcap").messages.empty());
  McapWriter writer(directory / "channel.mcap", "p");
  (void)writer.add_channel(writer.add_schema("s", "jsonschema", "{}"), "/t", "json");
  writer.close();
  const McapFile file = McapReader::read(directory / "channel.mcap");
  EXPECT_EQ(file.channels.size(), 1u);
  EXPECT_EQ(file.chunks, 1);
}

TEST(McapWriter, LeavesNothingUnlessClosed) {
  const TemporaryDirectory directory;
  write_text(directory / "log.mcap", "what was there before");
  {
    McapWriter writer(directory / "log.mcap", "p", {.chunk_bytes = 10});
    const std::uint16_t channel = writer.add_channel(writer.add_schema("s", "jsonschema", "{}"), "/t", "json");
    for (int i = 0; i < 100; ++i) writer.write(channel, 1, "0123456789");
  }
  EXPECT_EQ(read_text(directory / "log.mcap"), "what was there before");
  EXPECT_EQ(std::distance(fs::directory_iterator(directory.path()), fs::directory_iterator()), 1);
}

TEST(McapWriter, NamesWhatCannotBeWritten) {
  const TemporaryDirectory directory;
  try {
    McapWriter writer(directory / "none/log.mcap", "p");
    ADD_FAILURE() << "there is no such directory";
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(error.what(), (directory / "none/log.mcap").string() + ": cannot be written: No such file or directory");
  }
}

TEST(McapWriter, RefusesMoreTopicsThanCanBeNumbered) {
  const TemporaryDirectory directory;
  McapWriter writer(directory / "log.mcap", "p");
  const std::uint16_t schema = writer.add_schema("s", "jsonschema", "{}");
  for (int i = 1; i < 65536; ++i) ASSERT_EQ(writer.add_channel(schema, "/t", "json"), i);
  EXPECT_THROW((void)writer.add_channel(schema, "/t", "json"), std::runtime_error);
}

}  // namespace
}  // namespace swarm::test
