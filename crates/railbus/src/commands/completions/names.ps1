    # Names of modules, points and codes, from the configuration.
    $words = @($commandElements | Select-Object -Skip 1 | ForEach-Object { "$_" })
    if ($wordToComplete -eq '') { $words += '' }
    $completions = @($completions) + @(railbus complete -- @words 2>$null | ForEach-Object {
        [CompletionResult]::new($_, $_, [CompletionResultType]::ParameterValue, $_)
    })

