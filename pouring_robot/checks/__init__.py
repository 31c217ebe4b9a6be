"""What is wrong with a campaign's data, before any fit: findings with rows, columns, figures and a remedy."""
