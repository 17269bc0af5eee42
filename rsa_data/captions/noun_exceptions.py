"""Nouns that the rules of English do not cover: exceptions to articles and plurals.

Every plural of the class names of COCO panoptic, LVIS and ADE20K was read by eye; what inflect gets
wrong stands here. A table goes by the whole name or by its last word ("short pants" by "pants").
"""

# Countable, where inflect errs or another table would catch the last word.
PLURALS = {
    "banjo": "banjos",
    "bell pepper": "bell peppers",
    "burrito": "burritos",
    "chest of drawers": "chests of drawers",
    "elk": "elk",
    "flamingo": "flamingos",
    "Lego": "Legos",
    "squid": "squid",
}


def names(words: str) -> tuple[str, ...]:
    """Names from a text: spaces between them, a hyphen for a space inside one."""
    return tuple(word.replace("-", " ") for word in words.split())


# Plural already, and said of one thing: "scissors occupy"; several are pairs of it.
PAIRS = names(
    """binoculars breeches clippers drawers eyeglasses glasses goggles jeans leggings overalls
    pajamas pants pantyhose pliers pyjamas scissors shears shorts spectacles sunglasses suspenders
    tights tongs trousers tweezers underdrawers"""
)

# Plural already, and the same of several.
PLURAL = names(
    """bleachers blinds boots chopsticks clothes curtains earphones flowers gloves headphones
    leaves lights people shoes skis slippers sneakers sprouts stairs steps vegetables"""
)

# Not countable, so without an article; several are so many areas, pieces or portions of it.
MASS = {
    "areas": names("dirt earth grass gravel ground land mud sand snow soil water"),
    "pieces": names(
        """apparel armor asparagus bait bamboo bean-curd beef bread broccoli bubble-gum cardboard
        cauliflower celery chain-mail chinaware clothing corn cornbread crabmeat dental-floss
        duct-tape flannel fleece footwear fudge furniture garbage garlic gelatin gift-wrap ginger
        ham jewelry leather lettuce luggage meat money parchment pottery salami soap sportswear
        string-cheese sugarcane sushi tinfoil tinsel tissue-paper toast toilet-tissue underwear
        vegetation"""
    ),
    "portions": names(
        """alcohol applesauce batter butter cayenne cereal cheese cider cocoa coleslaw cornmeal
        detergent food grits honey hummus ice-cream jam juice lemonade lip-balm liquor medicine
        milk mousse olive-oil pepper perfume popcorn pudding rice root-beer salsa sauce shampoo
        shaving-cream sour-cream tequila toothpaste vinegar vodka whipped-cream yogurt"""
    ),
}
