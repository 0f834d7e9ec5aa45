#include "server/service/session_judge.h"

#include <gmock/gmock.h>

namespace mapp {
namespace {

using ::testing::HasSubstr;

const SessionId kSession(7);

class SessionJudgeTest : public ::testing::Test {
 protected:
  std::optional<Ruling> Say(uint32_t keyframe, Finding finding) {
    return judge_.Add(kSession, keyframe, {finding, "some figures"});
  }

  SessionJudge judge_;
};

TEST_F(SessionJudgeTest, ThreeFalseKeyframesOfFiveAreEnough) {
  EXPECT_FALSE(Say(0, Finding::kConsistent));
  EXPECT_FALSE(Say(1, Finding::kOwnPoints));
  EXPECT_FALSE(Say(2, Finding::kConsistent));
  EXPECT_FALSE(Say(3, Finding::kOwnPoints));
  EXPECT_FALSE(Say(4, Finding::kSilent)) << "says nothing, takes no place";
  const auto ruling = Say(5, Finding::kOwnPoints);
  ASSERT_TRUE(ruling);
  EXPECT_EQ(ruling->finding, Finding::kOwnPoints);
  EXPECT_EQ(ruling->first_suspect, 1U);
  EXPECT_THAT(ruling->reason, HasSubstr("keyframes 1, 3, 5"));
  EXPECT_THAT(ruling->reason, HasSubstr("some figures"));
}

TEST_F(SessionJudgeTest, FalseKeyframesFarApartAreForgiven) {
  for (uint32_t keyframe = 0; keyframe < 60; ++keyframe) {
    EXPECT_FALSE(Say(keyframe, keyframe % 3 == 0 ? Finding::kOwnPoints : Finding::kConsistent)) << keyframe;
  }
}

TEST_F(SessionJudgeTest, AKeyframeSaidTwiceCountsOnce) {
  for (int i = 0; i < 5; ++i) EXPECT_FALSE(Say(3, Finding::kMapDepths));
}

TEST_F(SessionJudgeTest, AgreementWipesOutWhatLookedMisplacedBefore) {
  for (uint32_t keyframe = 0; keyframe < 40; ++keyframe) {
    EXPECT_FALSE(Say(keyframe, keyframe % 4 == 3 ? Finding::kAgrees : Finding::kElsewhere)) << keyframe;
  }
}

TEST_F(SessionJudgeTest, WhatIsSuspectBeginsAfterTheLastAgreement) {
  Say(0, Finding::kSilent);
  Say(9, Finding::kAgrees);
  for (uint32_t keyframe = 12; keyframe < 19; ++keyframe) EXPECT_FALSE(Say(keyframe, Finding::kUnlike));
  const auto ruling = Say(19, Finding::kUnlike);
  ASSERT_TRUE(ruling);
  EXPECT_EQ(ruling->first_suspect, 10U);
  EXPECT_EQ(ruling->first_contradiction, 12U);
}

TEST_F(SessionJudgeTest, FindingsOfBeforeTheLastAgreementComeTooLate) {
  Say(30, Finding::kAgrees);
  for (uint32_t keyframe = 0; keyframe < 20; ++keyframe) EXPECT_FALSE(Say(keyframe, Finding::kElsewhere));
}

TEST_F(SessionJudgeTest, WhatItWasNotToldOfIsVouchedFor) {
  for (uint32_t keyframe = 100; keyframe < 103; ++keyframe) EXPECT_FALSE(Say(keyframe, Finding::kElsewhere));
  const auto ruling = Say(103, Finding::kElsewhere);
  ASSERT_TRUE(ruling);
  EXPECT_EQ(ruling->first_suspect, 100U);
}

TEST_F(SessionJudgeTest, SessionsDoNotMix) {
  for (uint64_t session = 1; session < 20; ++session) {
    EXPECT_FALSE(judge_.Add(SessionId(session), 0, {Finding::kBadDepths, ""}));
    EXPECT_FALSE(judge_.Add(SessionId(session), 1, {Finding::kBadDepths, ""}));
  }
}

}  // namespace
}  // namespace mapp
