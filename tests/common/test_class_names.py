"""The one cleaner of class names."""

import pytest

from rsa_data.common.class_names import clean


@pytest.mark.parametrize(
    ("label", "name"),
    [
        ("traffic light", "traffic light"),
        ("aerosol_can", "aerosol can"),
        ("bow_(decorative_ribbons)", "ribbon bow"),
        ("bow_(weapon)", "archery bow"),
        ("archery bow", "archery bow"),
        ("fish", "fish"),
        ("fish_(food)", "fish dish"),
        ("octopus_(animal)", "octopus"),
        ("octopus_(food)", "octopus dish"),
        ("pan_(for_cooking)", "cooking pan"),
        ("pan_(metal_container)", "metal pan"),
        ("salmon_(fish)", "salmon"),
        ("salmon_(food)", "salmon dish"),
        ("speaker_(stero_equipment)", "speaker"),
        ("a_(b_(c)_d)_e", "a e"),
        ("cut_(off", "cut"),
        ("wall-brick", "wall"),
        ("sky-other-merged", "sky"),
        ("door-stuff", "door"),
        ("window-blind", "window"),
        ("playingfield", "playing field"),
        ("hot-air_balloon", "hot-air balloon"),
        ("building;edifice", "building"),
        ("sofa, couch, lounge", "couch"),
        ("T-shirt", "T-shirt"),
        ("NO-Hardhat", "NO-Hardhat"),
        ("glass-tile", "glass-tile"),
        ("object--street-light", "object--street-light"),
        ("traffic light", "traffic light"),
        ("hair_drier", "hair drier"),
        ("pottedplant", "potted plant"),
        ("tvmonitor", "tv"),
        ("windowpane, window ", "windowpane"),
        ("monitor_(computer_equipment) computer_monitor", "computer monitor"),
        ("  two\twords\n", "two words"),
        ("nul\x00l", "nul l"),
        ("लड़की", "लड़की"),
        ("漢字", "漢字"),
        ("'quoted'.", "quoted"),
        ("", "object"),
        ("___", "object"),
        ("(gloss)", "object"),
    ],
)
def test_one_name(label, name):
    assert clean(label) == name
