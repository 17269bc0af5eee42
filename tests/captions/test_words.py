"""Class names as English: cleaned, articles, plurals."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsa_data.captions.words import number_word, word
from rsa_data.common.class_names import clean


@pytest.mark.parametrize(
    ("label", "one", "several"),
    [
        ("bed", "a bed", "beds"),
        ("orange", "an orange", "oranges"),
        ("umbrella", "an umbrella", "umbrellas"),
        ("unicycle", "a unicycle", "unicycles"),
        ("urinal", "a urinal", "urinals"),
        ("hourglass", "an hourglass", "hourglasses"),
        ("urn", "an urn", "urns"),
        ("iPod", "an iPod", "iPods"),
        ("tv", "a tv", "tvs"),
        ("CD_player", "a CD player", "CD players"),
        ("stairs", "stairs", "stairs"),
        ("skis", "skis", "skis"),
        ("scissors", "scissors", "pairs of scissors"),
        ("trousers", "trousers", "pairs of trousers"),
        ("sunglasses", "sunglasses", "pairs of sunglasses"),
        ("wine glass", "a wine glass", "wine glasses"),
        ("knife", "a knife", "knives"),
        ("shelf", "a shelf", "shelves"),
        ("roof", "a roof", "roofs"),
        ("handkerchief", "a handkerchief", "handkerchiefs"),
        ("person", "a person", "people"),
        ("snowman", "a snowman", "snowmen"),
        ("ottoman", "an ottoman", "ottomans"),
        ("sheep", "a sheep", "sheep"),
        ("goose", "a goose", "geese"),
        ("mouse", "a mouse", "mice"),
        ("die", "a die", "dice"),
        ("bus", "a bus", "buses"),
        ("banjo", "a banjo", "banjos"),
        ("burrito", "a burrito", "burritos"),
        ("potato", "a potato", "potatoes"),
        ("chest of drawers", "a chest of drawers", "chests of drawers"),
        ("drawer", "a drawer", "drawers"),
        ("bell_pepper", "a bell pepper", "bell peppers"),
        ("small yellow bell pepper", "a small yellow bell pepper", "small yellow bell peppers"),
        ("vanilla ice cream", "vanilla ice cream", "portions of vanilla ice cream"),
        ("brussels_sprouts", "brussels sprouts", "brussels sprouts"),
        ("grass-merged", "grass", "areas of grass"),
        ("water-other", "water", "areas of water"),
        ("broccoli", "broccoli", "pieces of broccoli"),
        ("orange_juice", "orange juice", "portions of orange juice"),
        ("first-aid_kit", "a first-aid kit", "first-aid kits"),
        ("flip-flop_(sandal)", "a flip-flop", "flip-flops"),
        ("Street Lights", "Street Lights", "Street Lights"),
    ],
)
def test_one_and_several(label, one, several):
    found = word(label)
    assert (found.article + found.name, found.plural) == (one, several)


@pytest.mark.parametrize(("number", "text"), [(2, "two"), (17, "seventeen"), (21, "twenty-one")])
def test_number_word(number, text):
    assert number_word(number) == text


def categories(folder):
    coco = json.loads((folder / "panoptic_coco_categories.json").read_text())
    lvis = json.loads((folder / "lvis_v1_train_cat_info.json").read_text())
    ade = (folder / "objectInfo150.txt").read_text().splitlines()[1:]
    return {
        "coco": [c["name"] for c in coco],
        "lvis": [c["name"] for c in lvis],
        "ade20k": [line.split("\t")[4] for line in ade],
    }


# Every class whose plural is not the name and an s, read by eye.
IRREGULAR_COCO = {
    "person": "people", "bus": "buses", "bench": "benches", "sheep": "sheep", "skis": "skis",
    "wine glass": "wine glasses", "knife": "knives", "sandwich": "sandwiches",
    "broccoli": "pieces of broccoli", "couch": "couches", "mouse": "mice",
    "scissors": "pairs of scissors", "toothbrush": "toothbrushes",
    "cardboard": "pieces of cardboard", "gravel": "areas of gravel", "sand": "areas of sand",
    "shelf": "shelves", "snow": "areas of snow", "stairs": "stairs", "water": "areas of water",
    "sky": "skies", "grass": "areas of grass", "dirt": "areas of dirt", "food": "portions of food",
}  # fmt: skip
IRREGULAR_ADE = {
    "sky": "skies", "grass": "areas of grass", "person": "people", "earth": "areas of earth",
    "water": "areas of water", "shelf": "shelves", "box": "boxes",
    "chest of drawers": "chests of drawers", "sand": "areas of sand", "stairs": "stairs",
    "bench": "benches", "bus": "buses", "apparel": "pieces of apparel", "land": "areas of land",
    "canopy": "canopies", "couch": "couches", "food": "portions of food", "glass": "glasses",
}  # fmt: skip


# The same of LVIS: of what there are pairs, areas, pieces and portions, and the other plurals.
LVIS_AMOUNTS = {
    "pairs": """
        binoculars, suspenders, clippers, underdrawers, goggles, overalls, pajamas,
        pantyhose, pliers, scissors, shears, short pants, spectacles, sunglasses, sweat
        pants, tights, tongs, trousers
    """,
    "pieces": """
        armor, asparagus, bait, bamboo, bean curd, beef, bread, broccoli, bubble gum,
        cauliflower, celery, chain mail, chinaware, edible corn, cornbread, crabmeat, dental
        floss, duct tape, flannel, fleece, French toast, fudge, garbage, garlic, gelatin,
        gift wrap, ginger, ham, jewelry, leather, lettuce, money, parchment, pottery,
        salami, soap, sportswear, string cheese, sugarcane, sushi, tinfoil, tinsel, tissue
        paper, toast, toilet tissue, underwear
    """,
    "portions": """
        alcohol, applesauce, batter, butter, cayenne, chocolate milk, chocolate mousse,
        cider, cocoa, coleslaw, cornmeal, detergent, dishwasher detergent, fruit juice,
        grits, honey, hot sauce, hummus, ice cream, jam, lemonade, lip balm, liquor,
        medicine, milk, olive oil, orange juice, peanut butter, pepper, perfume, pudding,
        root beer, salsa, shampoo, shaving cream, sour cream, soya milk, Tabasco sauce,
        tequila, toothpaste, vinegar, vodka, whipped cream, yogurt
    """,
}
LVIS_PLURALS = """
    ax>axes, baby buggy>baby buggies, battery>batteries, bench>benches, black sheep>black sheep,
    blackberry>blackberries, blueberry>blueberries, box>boxes, broach>broaches, brussels
    sprouts>brussels sprouts, horse buggy>horse buggies, bus>buses, butterfly>butterflies,
    calf>calves, camera lens>camera lenses, car battery>car batteries, cherry>cherries, cigar
    box>cigar boxes, cockroach>cockroaches, couch>couches, compass>compasses, crucifix>crucifixes,
    crutch>crutches, deer>deer, diary>diaries, die>dice, dinghy>dinghies, tux>tuxes,
    dish>dishes, domestic ass>domestic asses, dragonfly>dragonflies, dress>dresses, elk>elk,
    eyepatch>eyepatches, ferry>ferries, fish>fish, fish dish>fish dishes, flash>flashes,
    flute glass>flute glasses,
    glass>glasses, goldfish>goldfish, goose>geese, grizzly>grizzlies, hairbrush>hairbrushes,
    hand glass>hand glasses, hatbox>hatboxes, headscarf>headscarves,
    hippopotamus>hippopotamuses, hourglass>hourglasses, knife>knives, latch>latches,
    mailbox>mailboxes, mashed potato>mashed potatoes, matchbox>matchboxes, mattress>mattresses,
    mint candy>mint candies, mouse>mice, octopus>octopuses, octopus dish>octopus
    dishes, ostrich>ostriches,
    paintbrush>paintbrushes, pastry>pastries, patty>patties, peach>peaches, pencil box>pencil
    boxes, penny>pennies, person>people, pocket watch>pocket watches, pocketknife>pocketknives,
    pony>ponies, postbox>postboxes, potato>potatoes, pouch>pouches, puppy>puppies,
    radish>radishes, raspberry>raspberries, rhinoceros>rhinoceroses, salmon>salmon, salmon
    dish>salmon dishes,
    sandwich>sandwiches, scarf>scarves, school bus>school buses, scrubbing brush>scrubbing
    brushes, sheep>sheep, shot glass>shot glasses, snowman>snowmen, crawfish>crawfish,
    squid>squid, stagecoach>stagecoaches, starfish>starfish, steak knife>steak knives,
    strawberry>strawberries, stylus>styluses, sweet potato>sweet potatoes, tapestry>tapestries,
    telephoto lens>telephoto lenses, tomato>tomatoes, toolbox>toolboxes,
    toothbrush>toothbrushes, walrus>walruses, watch>watches, window box>window boxes,
    wineglass>wineglasses, wolf>wolves, wrench>wrenches
"""


@pytest.mark.parametrize(
    ("source", "count", "irregular"),
    [("coco", 133, IRREGULAR_COCO), ("ade20k", 150, IRREGULAR_ADE)],
)
def test_all_plurals_of_a_list(shared, source, count, irregular):
    labels = categories(shared / "categories")[source]
    assert len(labels) == count
    words = [word(label) for label in labels]
    assert {w.name: w.plural for w in words if w.plural != w.name + "s"} == irregular


def test_all_plurals_of_lvis(shared):
    words = [word(label) for label in categories(shared / "categories")["lvis"]]
    expected = dict(pair.strip().split(">") for pair in " ".join(LVIS_PLURALS.split()).split(","))
    for amount, names in LVIS_AMOUNTS.items():
        listed = [name.strip() for name in " ".join(names.split()).split(",")]
        expected |= {name: f"{amount} of {name}" for name in listed}
    assert {w.name: w.plural for w in words if w.plural != w.name + "s"} == expected


def test_all_lvis_names_are_words(shared):
    labels = categories(shared / "categories")["lvis"]
    assert len(labels) == 1203
    for label in labels:
        found = word(label)
        assert not set("_()") & set(found.name + found.plural), label
        assert found.article in ("a ", "an ", "")
    assert len({word(label).name for label in labels}) == 1203


def test_lvis_articles_differ_from_the_letter_where_the_sound_does(shared):
    words = [word(label) for label in categories(shared / "categories")["lvis"]]
    vowels = "aeiouAEIOU"
    odd = {
        w.article + w.name
        for w in words
        if w.article and (w.article == "an ") != (w.name[0] in vowels)
    }
    assert odd == {"an hourglass", "a unicycle", "a urinal"}


@settings(deadline=None)
@given(st.text(max_size=80))
def test_any_label_has_words(label):
    found = word(label)
    assert found.name and found.plural
    assert clean(found.name) == found.name
    assert found.name.isprintable()
    assert word(found.name) == found


def test_portions_are_singular_but_for_grits():
    assert [word(name).is_plural for name in ("butter", "grass", "cheese", "grits")] == [
        False, False, False, True,
    ]  # fmt: skip
