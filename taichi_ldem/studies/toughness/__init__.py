"""What a crack costs, over its direction and the module size: ``ldem study toughness``."""
