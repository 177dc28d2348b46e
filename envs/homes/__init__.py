"""CareHomes: houses made by rule from data, at three levels of accessibility."""
