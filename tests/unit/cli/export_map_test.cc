#include "cli/export_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::EndsWith;
using testing::HasSubstr;

MapContent TwoPoints() {
  MapContent content;
  content.points.push_back({{1.5, -2.25, 1000}, 7, 0.5F, 3});
  content.points.push_back({{0, 0, 0}, 1, 1.0F, 4});
  return content;
}

TEST(FormatPlyTest, WritesText) {
  const std::string ply = FormatPly(TwoPoints(), PlyEncoding::kAscii);
  EXPECT_EQ(ply.rfind("ply\nformat ascii 1.0\n", 0), 0);
  EXPECT_THAT(ply, HasSubstr("element vertex 2\n"));
  EXPECT_THAT(ply, EndsWith("end_header\n1.50000 -2.25000 1000.00000 7 0.5000 3\n"
                            "0.00000 0.00000 0.00000 1 1.0000 4\n"));
}

TEST(FormatPlyTest, WritesLittleEndianRecordsOf24Bytes) {
  const std::string ply = FormatPly(TwoPoints(), PlyEncoding::kBinary);
  EXPECT_THAT(ply, HasSubstr("format binary_little_endian 1.0\n"));
  const std::string end = "end_header\n";
  const std::string body = ply.substr(ply.find(end) + end.size());
  ASSERT_EQ(body.size(), 2 * 24);
  const std::string y_of_first = body.substr(4, 4);
  EXPECT_EQ(y_of_first, std::string("\x00\x00\x10\xc0", 4)) << "-2.25 as IEEE 754";
  EXPECT_EQ(body.substr(12, 4), std::string("\x07\x00\x00\x00", 4));
}

TEST(FormatPlyTest, WritesColors) {
  const std::vector<Color> colors = {{200, 30, 40}, {1, 2, 3}};
  const std::string text = FormatPly(TwoPoints(), PlyEncoding::kAscii, colors);
  EXPECT_THAT(text, HasSubstr("property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"));
  EXPECT_THAT(text, EndsWith(" 7 0.5000 3 200 30 40\n0.00000 0.00000 0.00000 1 1.0000 4 1 2 3\n"));
  EXPECT_THAT(FormatPly(TwoPoints(), PlyEncoding::kBinary, colors), EndsWith(std::string("\x04\0\0\0\x01\x02\x03", 7)));
}

TEST(FormatPlyTest, WritesAnEmptyMap) { EXPECT_THAT(FormatPly({}, PlyEncoding::kBinary), EndsWith("end_header\n")); }

}  // namespace
}  // namespace mapp
