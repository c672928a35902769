"""Joint names and trees of many exporters, in the notation of ``exporters.convention``."""

from __future__ import annotations

from exporters import Convention, convention

_FINGERS = """
{pad}~{hand}Thumb1 left_hand left_hand>left_elbow:-.15+0,-.01,.015
{pad}  ~{hand}Thumb2 left_hand left_hand>left_elbow:-.25+0,-.01,.025
{pad}    ~{hand}Thumb3 left_hand left_hand>left_elbow:-.33+0,-.01,.03
{pad}~{hand}Index1 left_hand left_hand>left_elbow:-.36+0,0,.015
{pad}  ~{hand}Index2 left_hand left_hand>left_elbow:-.5+0,0,.015
{pad}    ~{hand}Index3 left_hand left_hand>left_elbow:-.6+0,0,.015
{pad}~{hand}Pinky1 left_hand left_hand>left_elbow:-.3+0,0,-.02
{pad}  ~{hand}Pinky2 left_hand left_hand>left_elbow:-.4+0,0,-.02
"""


def _fingers(pad: int, hand: str) -> str:
    return _FINGERS.format(pad=" " * pad, hand=hand)


LEFT_RIGHT = ("Left", "Right")

CMU = """
Hips pelvis
  ~HipJoint pelvis pelvis
    ~UpLeg left_hip
      ~Leg left_knee
        ~Foot left_foot
          ~ToeBase left_toe
  LowerBack pelvis pelvis
    Spine spine
      Spine1 chest
        Neck neck
          Neck1 neck neck>head:.5
            Head head
        ~Shoulder chest chest>left_shoulder:.05+0,.05,0
          ~Arm left_shoulder
            ~ForeArm left_elbow
              ~Hand left_hand
                ~FingerBase left_hand left_hand
                  ~HandIndex1 left_hand left_hand>left_elbow:-.3
                ~Thumb left_hand left_hand>left_elbow:-.1+0,0,.02
"""
ASF = """
root pelvis
  ~hipjoint pelvis pelvis
    ~femur left_hip
      ~tibia left_knee
        ~foot left_foot
          ~toes left_toe
  lowerback spine
    upperback spine spine>chest:.5
      thorax chest
        lowerneck neck
          upperneck neck neck>head:.5
            head head
        ~clavicle chest chest
          ~humerus left_shoulder
            ~radius left_elbow
              ~wrist left_hand
                ~hand left_hand left_hand>left_elbow:-.2
                  ~fingers left_hand left_hand>left_elbow:-.4
                ~thumb left_hand left_hand>left_elbow:-.1+0,0,.02
"""
MOTIONBUILDER_OLD = """
Hips pelvis
  ~Hip left_hip
    ~Knee left_knee
      ~Ankle left_foot
        ~Toe left_toe
  Chest spine
    Chest2 chest
      ~Collar chest neck>left_shoulder:.2
        ~Shoulder left_shoulder
          ~Elbow left_elbow
            ~Wrist left_hand
      Neck neck
        Head head
"""
MIXAMO = (
    """
mixamorig:Hips pelvis
  mixamorig:Spine spine
    mixamorig:Spine1 spine spine>chest:.5
      mixamorig:Spine2 chest
        mixamorig:Neck neck
          mixamorig:Head head
            mixamorig:HeadTop_End head head+0,.1,0
            mixamorig:~Eye head head+.02,.05,.05
        mixamorig:~Shoulder chest neck>left_shoulder:.2
          mixamorig:~Arm left_shoulder
            mixamorig:~ForeArm left_elbow
              mixamorig:~Hand left_hand
"""
    + _fingers(16, "Hand").replace("~", "mixamorig:~")
    + """
  mixamorig:~UpLeg left_hip
    mixamorig:~Leg left_knee
      mixamorig:~Foot left_foot
        mixamorig:~ToeBase left_toe
          mixamorig:~Toe_End left_toe left_toe+0,0,.04
"""
)
BIPED = """
Bip01 | pelvis | pelvis
  Bip01 Pelvis | pelvis
    Bip01 Spine | spine
      Bip01 Spine1 | chest
        Bip01 Neck | neck
          Bip01 ~ Clavicle | chest | neck>left_shoulder:.2
            Bip01 ~ UpperArm | left_shoulder
              Bip01 ~ Forearm | left_elbow
                Bip01 ~ Hand | left_hand
                  Bip01 ~ Finger0 | left_hand | left_hand>left_elbow:-.2
                    Bip01 ~ Finger01 | left_hand | left_hand>left_elbow:-.4
          Bip01 Head | head
    Bip01 ~ Thigh | left_hip
      Bip01 ~ Calf | left_knee
        Bip01 ~ Foot | left_foot
          Bip01 ~ Toe0 | left_toe
"""
DAZ_GENESIS = """
hip pelvis pelvis+0,.03,0
  pelvis pelvis
    ~ThighBend left_hip
      ~ThighTwist left_hip left_hip>left_knee:.5
        ~Shin left_knee
          ~Foot left_foot
            ~Metatarsals left_foot left_foot>left_toe:.5
              ~Toe left_toe
                ~BigToe left_toe left_toe+0,0,.02
  abdomenLower spine
    abdomenUpper spine spine>chest:.5
      chestLower spine spine>chest:.7
        chestUpper chest
          ~Collar chest neck>left_shoulder:.2
            ~ShldrBend left_shoulder
              ~ShldrTwist left_shoulder left_shoulder>left_elbow:.5
                ~ForearmBend left_elbow
                  ~ForearmTwist left_elbow left_elbow>left_hand:.5
                    ~Hand left_hand
                      ~Thumb1 left_hand left_hand>left_elbow:-.2
          neckLower neck
            neckUpper neck neck>head:.5
              head head
"""
POSER = """
hip pelvis
  abdomen spine
    chest chest
      neck neck
        head head
          leftEye head head+.02,.05,.05
          rightEye head head+-.02,.05,.05
      ~Collar chest neck>left_shoulder:.2
        ~Shldr left_shoulder
          ~ForeArm left_elbow
            ~Hand left_hand
              ~Thumb1 left_hand left_hand>left_elbow:-.2
              ~Mid1 left_hand left_hand>left_elbow:-.35
  ~Buttock pelvis pelvis>left_hip:.4
    ~Thigh left_hip
      ~Shin left_knee
        ~Foot left_foot
"""
RIGIFY = """
root world world
  DEF-spine pelvis
    DEF-spine.001 spine
      DEF-spine.002 spine spine>chest:.5
        DEF-spine.003 chest
          DEF-spine.004 neck
            DEF-spine.005 neck neck>head:.5
              DEF-spine.006 head
          DEF-shoulder.~ chest neck>left_shoulder:.2
            DEF-upper_arm.~ left_shoulder
              DEF-upper_arm.~.001 left_shoulder left_shoulder>left_elbow:.5
                DEF-forearm.~ left_elbow
                  DEF-forearm.~.001 left_elbow left_elbow>left_hand:.5
                    DEF-hand.~ left_hand
                      DEF-palm.01.~ left_hand left_hand>left_elbow:-.1
                        DEF-f_index.01.~ left_hand left_hand>left_elbow:-.35
    DEF-pelvis.~ pelvis pelvis
    DEF-thigh.~ left_hip
      DEF-thigh.~.001 left_hip left_hip>left_knee:.5
        DEF-shin.~ left_knee
          DEF-shin.~.001 left_knee left_knee>left_foot:.5
            DEF-foot.~ left_foot
              DEF-toe.~ left_toe
"""
BLENDER_META = """
spine pelvis
  spine.001 spine
    spine.002 spine spine>chest:.5
      spine.003 chest
        spine.004 neck
          spine.005 neck neck>head:.5
            spine.006 head
        shoulder.~ chest neck>left_shoulder:.2
          upper_arm.~ left_shoulder
            forearm.~ left_elbow
              hand.~ left_hand
  thigh.~ left_hip
    shin.~ left_knee
      foot.~ left_foot
        toe.~ left_toe
        heel.02.~ left_foot left_foot+0,-.04,-.03
"""
MAKEHUMAN = """
root pelvis
  pelvis.~ pelvis pelvis
    upperleg01.~ left_hip
      upperleg02.~ left_hip left_hip>left_knee:.2
        lowerleg01.~ left_knee
          lowerleg02.~ left_knee left_knee>left_foot:.5
            foot.~ left_foot
              metatarsal1.~ left_foot left_foot>left_toe:.5
                toe1-1.~ left_toe
                  toe1-2.~ left_toe left_toe+0,0,.02
              metatarsal5.~ left_foot left_foot>left_toe:.5+.01,0,0
                toe5-1.~ left_toe left_toe+.02,0,0
  spine05 pelvis pelvis
    spine04 spine spine>spine:0
      spine03 spine spine>chest:.4
        spine02 spine spine>chest:.7
          spine01 chest
            clavicle.~ chest neck>left_shoulder:.15
              shoulder01.~ chest neck>left_shoulder:.5
                upperarm01.~ left_shoulder
                  upperarm02.~ left_shoulder left_shoulder>left_elbow:.3
                    lowerarm01.~ left_elbow
                      lowerarm02.~ left_elbow left_elbow>left_hand:.5
                        wrist.~ left_hand
                          finger1-1.~ left_hand left_hand>left_elbow:-.15
                          metacarpal1.~ left_hand left_hand>left_elbow:-.1
                            finger2-1.~ left_hand left_hand>left_elbow:-.35
            neck01 neck
              neck02 neck neck>head:.4
                neck03 neck neck>head:.7
                  head head
                    jaw head head+0,0,.03
                    eye.~ head head+.02,.05,.05
"""
CONNECTORS = """
Root pelvis
  Hips pelvis
    __UpLeg~ pelvis pelvis+0,-.01,0
      UpLeg~ left_hip
        LoLeg~ left_knee
          Foot~ left_foot
            Toe~ left_toe
    Spine1 spine
      Spine2 spine spine>chest:.5
        Spine3 chest
          Neck neck
            Head head
          __Shoulder~ chest chest
            Shoulder~ chest neck>left_shoulder:.2
              UpArm~ left_shoulder
                LoArm~ left_elbow
                  Hand~ left_hand
"""
"""Bones whose parents end elsewhere than they begin hang on joints that carry no rotation."""
XSENS = """
Hips pelvis
  Chest spine
    Chest2 spine spine>chest:.3
      Chest3 spine spine>chest:.7
        Chest4 chest
          Neck neck
            Head head
          ~Collar chest neck>left_shoulder:.2
            ~Shoulder left_shoulder
              ~Elbow left_elbow
                ~Wrist left_hand
  ~Hip left_hip
    ~Knee left_knee
      ~Ankle left_foot
        ~Toe left_toe
"""
XSENS_MVN = """
Pelvis pelvis
  ~UpperLeg left_hip
    ~LowerLeg left_knee
      ~Foot left_foot
        ~Toe left_toe
  L5 spine
    L3 spine spine>chest:.3
      T12 spine spine>chest:.6
        T8 chest
          Neck neck
            Head head
          ~Shoulder chest neck>left_shoulder:.2
            ~UpperArm left_shoulder
              ~ForeArm left_elbow
                ~Hand left_hand
"""
ROKOKO = (
    """
Hips pelvis
  Spine spine
    Spine2 spine spine>chest:.4
      Spine3 spine spine>chest:.7
        Spine4 chest
          Neck neck
            Head head
          ~Shoulder chest neck>left_shoulder:.2
            ~Arm left_shoulder
              ~ForeArm left_elbow
                ~Hand left_hand
"""
    + _fingers(18, "Finger")
    + """
  ~Thigh left_hip
    ~Shin left_knee
      ~Foot left_foot
        ~Toe left_toe
          ~ToeTip left_toe left_toe+0,0,.04
"""
)
PERCEPTION_NEURON = """
Hips pelvis
  ~UpLeg left_hip
    ~Leg left_knee
      ~Foot left_foot
  Spine spine
    Spine1 spine spine>chest:.5
      Spine2 spine spine>chest:.8
        Spine3 chest
          Neck neck
            Head head
          ~Shoulder chest neck>left_shoulder:.2
            ~Arm left_shoulder
              ~ForeArm left_elbow
                ~Hand left_hand
                  ~HandThumb1 left_hand left_hand>left_elbow:-.1+0,0,.01
                    ~HandThumb2 left_hand left_hand>left_elbow:-.2+0,0,.01
                  ~InHandIndex left_hand left_hand>left_elbow:-.1
                    ~HandIndex1 left_hand left_hand>left_elbow:-.3
                      ~HandIndex2 left_hand left_hand>left_elbow:-.4
"""
OPTITRACK = """
Hip pelvis
  Ab spine
    Chest chest
      Neck neck
        Head head
      ~Shoulder chest neck>left_shoulder:.2
        ~UArm left_shoulder
          ~FArm left_elbow
            ~Hand left_hand
              ~Thumb1 left_hand left_hand>left_elbow:-.2
  ~Thigh left_hip
    ~Shin left_knee
      ~Foot left_foot
        ~Toe left_toe
"""
MOTIVE = OPTITRACK.replace("Hip pelvis", "Skeleton:Hip pelvis")
SMPL = """
Pelvis pelvis
  ~_Hip left_hip
    ~_Knee left_knee
      ~_Ankle left_foot
        ~_Foot left_toe
  Spine1 spine
    Spine2 spine spine>chest:.5
      Spine3 chest
        Neck neck
          Head head
        ~_Collar chest neck>left_shoulder:.2
          ~_Shoulder left_shoulder
            ~_Elbow left_elbow
              ~_Wrist left_hand
                ~_Hand left_hand left_hand>left_elbow:-.3
"""
SMPLX = SMPL.lower()
LAFAN = """
Hips pelvis
  ~UpLeg left_hip
    ~Leg left_knee
      ~Foot left_foot
        ~Toe left_toe
  Spine spine
    Spine1 spine spine>chest:.5
      Spine2 chest
        Neck neck
          Head head
        ~Shoulder chest neck>left_shoulder:.2
          ~Arm left_shoulder
            ~ForeArm left_elbow
              ~Hand left_hand
"""
BANDAI = """
joint_Root world world
  Hips pelvis
    Spine spine
      Chest chest
        Neck neck
          Head head
        Shoulder_~ chest neck>left_shoulder:.2
          UpperArm_~ left_shoulder
            LowerArm_~ left_elbow
              Hand_~ left_hand
    UpperLeg_~ left_hip
      LowerLeg_~ left_knee
        Foot_~ left_foot
          Toes_~ left_toe
"""
UNREAL = """
root world world
  pelvis pelvis
    spine_01 spine
      spine_02 spine spine>chest:.5
        spine_03 chest
          clavicle_~ chest neck>left_shoulder:.2
            upperarm_~ left_shoulder
              upperarm_twist_01_~ left_shoulder left_shoulder>left_elbow:.5
              lowerarm_~ left_elbow
                lowerarm_twist_01_~ left_elbow left_elbow>left_hand:.5
                hand_~ left_hand
                  index_01_~ left_hand left_hand>left_elbow:-.35
                    index_02_~ left_hand left_hand>left_elbow:-.5
                  thumb_01_~ left_hand left_hand>left_elbow:-.15
          neck_01 neck
            head head
    thigh_~ left_hip
      thigh_twist_01_~ left_hip left_hip>left_knee:.5
      calf_~ left_knee
        calf_twist_01_~ left_knee left_knee>left_foot:.5
        foot_~ left_foot
          ball_~ left_toe
  ik_foot_root world world
    ik_foot_~ left_foot left_foot
  ik_hand_root world world
    ik_hand_gun right_hand right_hand
      ik_hand_~ left_hand right_hand
"""
VRM = """
Root world world
  J_Bip_C_Hips pelvis
    J_Bip_C_Spine spine
      J_Bip_C_Chest spine spine>chest:.5
        J_Bip_C_UpperChest chest
          J_Sec_~_Bust1 chest chest+.04,.02,.06
            J_Sec_~_Bust2 chest chest+.04,.02,.08
          J_Bip_C_Neck neck
            J_Bip_C_Head head
              J_Sec_Hair1_01 head head+0,.1,0
                J_Sec_Hair2_01 head head+0,.1,-.08
                  J_Sec_Hair3_01 head head+0,0,-.1
                    J_Sec_Hair4_01 head head+0,-.1,-.1
                      J_Sec_Hair5_01 head head+0,-.2,-.1
          J_Bip_~_Shoulder chest neck>left_shoulder:.2
            J_Bip_~_UpperArm left_shoulder
              J_Bip_~_LowerArm left_elbow
                J_Bip_~_Hand left_hand
                  J_Bip_~_Index1 left_hand left_hand>left_elbow:-.35
    J_Bip_~_UpperLeg left_hip
      J_Bip_~_LowerLeg left_knee
        J_Bip_~_Foot left_foot
          J_Bip_~_ToeBase left_toe
"""
KINECT = """
SpineBase pelvis
  SpineMid spine
    SpineShoulder chest
      Neck neck
        Head head
      Shoulder~ left_shoulder
        Elbow~ left_elbow
          Wrist~ left_hand
            Hand~ left_hand left_hand>left_elbow:-.2
              HandTip~ left_hand left_hand>left_elbow:-.4
              Thumb~ left_hand left_hand>left_elbow:-.2+0,0,.02
  Hip~ left_hip
    Knee~ left_knee
      Ankle~ left_foot
        Foot~ left_toe
"""
AZURE = """
PELVIS pelvis
  SPINE_NAVEL spine
    SPINE_CHEST chest
      NECK neck
        HEAD head
          NOSE head head+0,.04,.06
          EYE_~ head head+.02,.06,.05
          EAR_~ head head+.05,.05,0
      CLAVICLE_~ chest neck>left_shoulder:.2
        SHOULDER_~ left_shoulder
          ELBOW_~ left_elbow
            WRIST_~ left_hand
              HAND_~ left_hand left_hand>left_elbow:-.2
                HANDTIP_~ left_hand left_hand>left_elbow:-.4
  HIP_~ left_hip
    KNEE_~ left_knee
      ANKLE_~ left_foot
        FOOT_~ left_toe
"""
IPI = """
Hip pelvis
  LowerSpine spine
    MiddleSpine spine spine>chest:.5
      Chest chest
        Neck neck
          Head head
        ~Clavicle chest neck>left_shoulder:.2
          ~Shoulder left_shoulder
            ~Forearm left_elbow
              ~Hand left_hand
  ~Thigh left_hip
    ~Shin left_knee
      ~Foot left_foot
        ~Toe left_toe
"""
CAPTURY = """
Root pelvis pelvis
  Hips pelvis
    Spine spine
      Spine1 spine spine>chest:.3
        Spine2 spine spine>chest:.5
          Spine3 spine spine>chest:.7
            Spine4 chest
              Neck neck
                Head head
                  HeadEE head head+0,.1,0
              ~Shoulder chest neck>left_shoulder:.2
                ~Arm left_shoulder
                  ~ForeArm left_elbow
                    ~Hand left_hand
                      ~HandEE left_hand left_hand>left_elbow:-.4
    ~UpLeg left_hip
      ~Leg left_knee
        ~Foot left_foot
          ~ToeBase left_toe
            ~FootEE left_toe left_toe+0,0,.04
"""
ACCAD = """
root world world
  Hips pelvis
    ToSpine pelvis pelvis
      Spine spine
        Spine1 chest
          Neck neck
            Head head
          ~Shoulder chest neck>left_shoulder:.2
            ~Arm left_shoulder
              ~ForeArm left_elbow
                ~Hand left_hand
    ~UpLeg left_hip
      ~Leg left_knee
        ~Foot left_foot
          ~ToeBase left_toe
"""
MIXED_CASE = """
HIPS pelvis
  ~HIP left_hip
    ~KNEE left_knee
      ~ANKLE left_foot
        ~TOE left_toe
  CHEST chest spine
    NECK neck
      HEAD head
    ~COLLAR chest neck>left_shoulder:.2
      ~SHOULDER left_shoulder
        ~ELBOW left_elbow
          ~WRIST left_hand
"""
JAPANESE = """
全ての親 world world
  センター pelvis pelvis+0,-.05,0
    上半身 spine
      上半身2 chest
        首 neck
          頭 head
            ~目 head head+.02,.05,.05
        ~肩 chest neck>left_shoulder:.2
          ~腕 left_shoulder
            ~ひじ left_elbow
              ~手首 left_hand
                ~親指 left_hand left_hand>left_elbow:-.2
    下半身 pelvis
      ~足 left_hip
        ~ひざ left_knee
          ~足首 left_foot
            ~つま先 left_toe
"""
FLAT = """
joint0 pelvis
  joint1~ left_hip
    joint2~ left_knee
      joint3~ left_foot
        joint4~ left_toe
  joint5 spine
    joint6 chest
      joint7~ chest neck>left_shoulder:.2
        joint8~ left_shoulder
          joint9~ left_elbow
            joint10~ left_hand
      joint11 neck
        joint12 head
"""
FLAT_FINGERS = """
b0 pelvis
  b1 spine
    b2 chest
      b3~ chest neck>left_shoulder:.2
        b4~ left_shoulder
          b5~ left_elbow
            b6~ left_hand
              b7~ left_hand left_hand>left_elbow:-.35+0,0,.015
                b8~ left_hand left_hand>left_elbow:-.5+0,0,.015
                  b9~ left_hand left_hand>left_elbow:-.6+0,0,.015
              b17~ left_hand left_hand>left_elbow:-.35+0,0,-.015
                b18~ left_hand left_hand>left_elbow:-.5+0,0,-.015
                  b19~ left_hand left_hand>left_elbow:-.6+0,0,-.015
      b10 neck
        b11 head
          b12~ head head+.02,.05,.05
  b13~ left_hip
    b14~ left_knee
      b15~ left_foot
        b16~ left_toe
          b26~ left_toe left_toe+0,0,.04
"""
NO_NECK = """
Hips pelvis
  ~UpLeg left_hip
    ~Leg left_knee
      ~Foot left_foot
        ~Toe left_toe
  Spine spine
    Chest chest
      Head head
      ~Arm left_shoulder
        ~ForeArm left_elbow
          ~Hand left_hand
"""
NO_TOES_NO_COLLARS = """
Hips pelvis
  ~UpLeg left_hip
    ~Leg left_knee
      ~Foot left_foot
  Spine spine
    Chest chest
      Neck neck
        Head head
      ~Arm left_shoulder
        ~ForeArm left_elbow
          ~Hand left_hand
"""
TWIST = """
Hips pelvis
  ~UpLeg left_hip
    ~UpLegRoll left_hip left_hip>left_knee:.5
      ~Leg left_knee
        ~LegRoll left_knee left_knee>left_foot:.5
          ~Foot left_foot
            ~ToeBase left_toe
  Spine spine
    Spine1 chest
      Neck neck
        Head head
      ~Shoulder chest neck>left_shoulder:.2
        ~Arm left_shoulder
          ~ArmRoll left_shoulder left_shoulder>left_elbow:.5
            ~ForeArm left_elbow
              ~ForeArmRoll left_elbow left_elbow>left_hand:.5
                ~Hand left_hand
"""

BIPED_THIGHS_ON_SPINE = """
Bip001 | pelvis | pelvis
  Bip001 Footsteps | world | world
  Bip001 Pelvis | pelvis
    Bip001 Spine | pelvis | pelvis+0,.02,0
      Bip001 ~ Thigh | left_hip
        Bip001 ~ Calf | left_knee
          Bip001 ~ Foot | left_foot
            Bip001 ~ Toe0 | left_toe
      Bip001 Spine1 | spine | spine>spine:0
        Bip001 Spine2 | chest
          Bip001 Neck | neck
            Bip001 ~ Clavicle | chest | neck>left_shoulder:.2
              Bip001 ~ UpperArm | left_shoulder
                Bip001 ~ Forearm | left_elbow
                  Bip001 ~ Hand | left_hand
            Bip001 Head | head
"""
CHARACTER_CREATOR = """
CC_Base_BoneRoot world world
  CC_Base_Hip pelvis pelvis
    CC_Base_Pelvis pelvis
      CC_Base_~_Thigh left_hip
        CC_Base_~_ThighTwist01 left_hip left_hip>left_knee:.2
        CC_Base_~_Calf left_knee
          CC_Base_~_CalfTwist01 left_knee left_knee>left_foot:.2
          CC_Base_~_Foot left_foot
            CC_Base_~_ToeBase left_toe
    CC_Base_Waist pelvis pelvis+0,.03,0
      CC_Base_Spine01 spine
        CC_Base_Spine02 chest
          CC_Base_NeckTwist01 neck
            CC_Base_NeckTwist02 neck neck>head:.5
              CC_Base_Head head
                CC_Base_FacialBone head head
                  CC_Base_~_Eye head head+.02,.05,.05
          CC_Base_~_Clavicle chest neck>left_shoulder:.2
            CC_Base_~_Upperarm left_shoulder
              CC_Base_~_UpperarmTwist01 left_shoulder left_shoulder>left_elbow:.2
              CC_Base_~_Forearm left_elbow
                CC_Base_~_Hand left_hand
                  CC_Base_~_Mid1 left_hand left_hand>left_elbow:-.35
"""
BIOVISION = """
Hips pelvis
  ~UpLeg left_hip
    ~LowLeg left_knee
      ~Foot left_foot
  Chest chest chest
    ~Collar chest neck>left_shoulder:.2
      ~UpArm left_shoulder
        ~LowArm left_elbow
          ~Hand left_hand
    Neck neck
      Head head
"""
ADVANCED_SKELETON = """
Root_M pelvis
  Hip_~ left_hip
    HipPart1_~ left_hip left_hip>left_knee:.3
      Knee_~ left_knee
        Ankle_~ left_foot
          Toes_~ left_toe
            ToesEnd_~ left_toe left_toe+0,0,.04
  Spine1_M spine
    Chest_M chest
      Scapula_~ chest neck>left_shoulder:.2
        Shoulder_~ left_shoulder
          Elbow_~ left_elbow
            Wrist_~ left_hand
              MiddleFinger1_~ left_hand left_hand>left_elbow:-.35
      Neck_M neck
        Head_M head
          Jaw_M head head+0,0,.03
          Eye_~ head head+.02,.05,.05
"""
PROPS = """
Reference world world
  Hips pelvis
    Spine spine
      Chest chest
        Neck neck
          Head head
        ~Shoulder chest neck>left_shoulder:.2
          ~Arm left_shoulder
            ~ForeArm left_elbow
              ~Hand left_hand
    ~UpLeg left_hip
      ~Leg left_knee
        ~Foot left_foot
          ~ToeBase left_toe
  Sword world world+.3,.5,.2
    SwordTip world world+.3,.5,.6
  Marker world world+-.2,0,.3
"""

CONVENTIONS: tuple[Convention, ...] = (
    convention("biped_thighs_on_spine", ("L", "R"), BIPED_THIGHS_ON_SPINE),
    convention("character_creator", ("L", "R"), CHARACTER_CREATOR),
    convention("biovision", LEFT_RIGHT, BIOVISION),
    convention("advanced_skeleton", ("L", "R"), ADVANCED_SKELETON),
    convention("props", LEFT_RIGHT, PROPS),
    convention("cmu", LEFT_RIGHT, CMU),
    convention("asf", ("l", "r"), ASF),
    convention("motionbuilder_old", LEFT_RIGHT, MOTIONBUILDER_OLD),
    convention("mixamo", LEFT_RIGHT, MIXAMO),
    convention("biped", ("L", "R"), BIPED),
    convention("daz_genesis", ("l", "r"), DAZ_GENESIS),
    convention("poser", ("l", "r"), POSER),
    convention("rigify", ("L", "R"), RIGIFY),
    convention("blender_meta", ("L", "R"), BLENDER_META),
    convention("makehuman", ("L", "R"), MAKEHUMAN),
    convention("connectors", ("_L", "_R"), CONNECTORS),
    convention("xsens", LEFT_RIGHT, XSENS),
    convention("xsens_mvn", LEFT_RIGHT, XSENS_MVN),
    convention("rokoko", LEFT_RIGHT, ROKOKO),
    convention("perception_neuron", LEFT_RIGHT, PERCEPTION_NEURON),
    convention("optitrack", ("L", "R"), OPTITRACK),
    convention("motive", ("L", "R"), MOTIVE),
    convention("smpl", ("L", "R"), SMPL),
    convention("smplx", ("left", "right"), SMPLX),
    convention("lafan", LEFT_RIGHT, LAFAN),
    convention("bandai", ("L", "R"), BANDAI),
    convention("unreal", ("l", "r"), UNREAL),
    convention("vrm", ("L", "R"), VRM),
    convention("kinect", LEFT_RIGHT, KINECT),
    convention("azure", ("LEFT", "RIGHT"), AZURE),
    convention("ipi", ("L", "R"), IPI),
    convention("captury", LEFT_RIGHT, CAPTURY),
    convention("accad", LEFT_RIGHT, ACCAD),
    convention("capitals", ("LEFT", "RIGHT"), MIXED_CASE),
    convention("japanese", ("左", "右"), JAPANESE),
    convention("flat", ("a", "b"), FLAT),
    convention("flat_fingers", ("x", "y"), FLAT_FINGERS),
    convention("no_neck", LEFT_RIGHT, NO_NECK),
    convention("no_toes_no_collars", LEFT_RIGHT, NO_TOES_NO_COLLARS),
    convention("twist", LEFT_RIGHT, TWIST),
)
"""Some with names that tell, some whose names tell nothing."""
