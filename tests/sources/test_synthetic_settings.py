import pytest
from pydantic import TypeAdapter, ValidationError

from sources.synthetic.settings import SyntheticSettings


def load(**values):
    return TypeAdapter(SyntheticSettings).validate_python({"type": "synthetic", **values})


def test_the_type_alone_is_a_stereo_rig():
    left, right = load().rig

    assert (left.name, right.name) == ("left", "right")
    assert left.position_m == (0, 0, 0)
    assert right.position_m == (0.12, 0, 0)
    assert (left.width, left.height, left.focal_px) == (640, 480, 512)


def test_a_number_of_cameras_names_and_places_them():
    rig = load(cameras=3, baseline_m=0.2).rig

    assert [camera.name for camera in rig] == ["cam0", "cam1", "cam2"]
    assert [camera.position_m[0] for camera in rig] == pytest.approx([0, 0.2, 0.4])


def test_a_camera_overrides_the_size_and_its_focal_length_follows():
    wide = load(cameras=[{}, {"width": 1280, "height": 720}]).rig[1]

    assert (wide.width, wide.height, wide.focal_px) == (1280, 720, 1024)


def test_driving_takes_the_street_and_the_rest_the_room():
    assert load(motion="drive").place == "street"
    assert load(motion="pan").place == "room"
    assert load(motion="handheld", scene="street").place == "street"


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"cameras": 1}, "a rig needs 2 to 64 cameras, not 1"),
        ({"cameras": [{"name": "top"}]}, "a rig needs 2 to 64 cameras, not 1"),
        ({"cameras": [{"name": "top"}, {"name": "top"}]}, "two cameras are named top"),
        ({"cameras": [{"name": "right"}, {}]}, "two cameras are named right"),
        ({"motion": "drive", "scene": "room"}, "motion drive does not fit scene room"),
        ({"motion": "objects", "scene": "street"}, "motion objects does not fit scene street"),
        ({"fps": 0}, "greater than or equal to 0.001"),
        ({"speed": 0}, "greater than 0"),
        ({"width": 31}, "greater than or equal to 32"),
        ({"cameras": [{"name": "Top"}, {}]}, "should match pattern"),
        ({"cameras": [{"noise_sigma": -1}, {}]}, "greater than or equal to 0"),
        ({"cameras": [{"nois_sigma": 1}, {}]}, "Extra inputs are not permitted"),
        ({"speed": "fast"}, "'max'"),
    ],
)
def test_what_makes_no_sense_is_refused_in_a_sentence(values, sentence):
    with pytest.raises(ValidationError, match=sentence):
        load(**values)
