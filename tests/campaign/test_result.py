"""A campaign as a user holds it: one import, one line at the prompt, a small table in a notebook."""

from pouring_robot import Campaign


def test_a_campaign_is_read_shown_and_saved(real, tmp_path):
    table, beside = real.campaign.save(tmp_path / "c.csv")
    campaign = Campaign.read(table)
    assert beside.is_file()
    assert repr(campaign) == f"<Campaign: {len(campaign)} full poses in 1 session, c.csv>"
    assert campaign.headline in campaign._repr_html_()
    assert len(campaign.to_frame()) == len(campaign)
