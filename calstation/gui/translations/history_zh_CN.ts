<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>ComparisonPlot</name>
    <message>
        <source>Values relative to their limits</source>
        <translation>参数值相对于限差</translation>
    </message>
    <message>
        <source>value relative to its limits</source>
        <translation>参数值与限差之比</translation>
    </message>
</context>
<context>
    <name>Filters</name>
    <message>
        <source>Search</source>
        <translation>查找</translation>
    </message>
    <message>
        <source>Every outcome</source>
        <translation>全部结果</translation>
    </message>
    <message>
        <source>Any time</source>
        <translation>任何时间</translation>
    </message>
    <message>
        <source>Today</source>
        <translation>今天</translation>
    </message>
    <message>
        <source>Last {0} days</source>
        <translation>最近 {0} 天</translation>
    </message>
    <message>
        <source>Part of a serial number, name or file</source>
        <translation>序列号、名称或文件名的一部分</translation>
    </message>
    <message>
        <source>Outcome</source>
        <translation>结果</translation>
    </message>
    <message>
        <source>Product</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>Station</source>
        <translation>工位</translation>
    </message>
    <message>
        <source>Operator</source>
        <translation>操作员</translation>
    </message>
    <message>
        <source>Time</source>
        <translation>时间</translation>
    </message>
    <message>
        <source>From date</source>
        <translation>起始日期</translation>
    </message>
    <message>
        <source>To date</source>
        <translation>截止日期</translation>
    </message>
    <message>
        <source>to</source>
        <translation>至</translation>
    </message>
    <message>
        <source>Dates</source>
        <translation>指定日期</translation>
    </message>
    <message>
        <source>Every product</source>
        <translation>全部产品</translation>
    </message>
    <message>
        <source>Every station</source>
        <translation>全部工位</translation>
    </message>
    <message>
        <source>Every operator</source>
        <translation>全部操作员</translation>
    </message>
</context>
<context>
    <name>HistoryPage</name>
    <message>
        <source>Show all runs</source>
        <translation>显示全部</translation>
    </message>
    <message>
        <source>Runs, the latest first</source>
        <translation>标定记录，最近的在前</translation>
    </message>
    <message>
        <source>Versions</source>
        <translation>版本对比</translation>
    </message>
    <message>
        <source>Folder of this run</source>
        <translation>本次标定的文件夹</translation>
    </message>
    <message>
        <source>Copy the path</source>
        <translation>复制路径</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>关闭</translation>
    </message>
    <message>
        <source>The runs could not be read</source>
        <translation>无法读取标定记录</translation>
    </message>
    <message>
        <source>Compare</source>
        <translation>比较</translation>
    </message>
    <message>
        <source>Compare solutions of all logs by two versions</source>
        <translation>比较全部数据记录在两个版本下的解算结果</translation>
    </message>
    <message>
        <source>Copying the log</source>
        <translation>正在复制数据记录</translation>
    </message>
    <message>
        <source>Reading the result</source>
        <translation>正在读取结果</translation>
    </message>
    <message>
        <source>The runs cannot be compared</source>
        <translation>无法比较这些标定</translation>
    </message>
    <message>
        <source>The log was not opened</source>
        <translation>数据记录未能打开</translation>
    </message>
    <message>
        <source>The result was not opened</source>
        <translation>结果未能打开</translation>
    </message>
    <message>
        <source>The run was not closed</source>
        <translation>这次标定未能结束</translation>
    </message>
    <message>
        <source>Export runs</source>
        <translation>导出标定记录</translation>
    </message>
    <message>
        <source>Select 2 to {0} runs with Ctrl or Shift</source>
        <translation>请用 Ctrl 或 Shift 选择 2 至 {0} 次标定</translation>
    </message>
    <message>
        <source>An incomplete run has no values to compare</source>
        <translation>未完成的标定没有可比较的数值</translation>
    </message>
    <message>
        <source>{0} runs, {1} shown</source>
        <translation>共 {0} 次，显示 {1} 次</translation>
    </message>
    <message>
        <source>1 run</source>
        <translation>共 1 次</translation>
    </message>
    <message>
        <source>{0} runs</source>
        <translation>共 {0} 次</translation>
    </message>
    <message>
        <source>Show the values of these runs side by side</source>
        <translation>并列显示这些标定的参数值</translation>
    </message>
    <message>
        <source>Export selection…</source>
        <translation>导出所选…</translation>
    </message>
    <message>
        <source>Export list…</source>
        <translation>导出列表…</translation>
    </message>
    <message>
        <source>Runs that are exported: {0}</source>
        <translation>将导出 {0} 次标定</translation>
    </message>
    <message>
        <source>There is no run to export</source>
        <translation>没有可导出的标定</translation>
    </message>
    <message>
        <source>No run matches</source>
        <translation>没有符合条件的记录</translation>
    </message>
    <message>
        <source>Search for less, or show all runs.</source>
        <translation>请减少筛选条件，或显示全部。</translation>
    </message>
    <message>
        <source>Every run will be listed here</source>
        <translation>每次标定都会列在这里</translation>
    </message>
    <message>
        <source>Passed, failed, stopped, faulty and incomplete ones, with their results and logs. Start a run on the first page.</source>
        <translation>合格、不合格、停止、故障和未完成的标定，连同结果和数据记录。
请在第一页开始标定。</translation>
    </message>
</context>
<context>
    <name>MovesPlot</name>
    <message>
        <source>Distribution of the moves</source>
        <translation>变化量分布</translation>
    </message>
    <message>
        <source>move, σ:  ● median   | 95 %   × largest</source>
        <translation>变化量，σ：  ● 中位数   | 95 %   × 最大</translation>
    </message>
</context>
<context>
    <name>ResolvesTable</name>
    <message>
        <source>Solved again offline</source>
        <translation>离线重新解算</translation>
    </message>
    <message>
        <source>Offline solutions of the log</source>
        <translation>本记录的离线解算</translation>
    </message>
    <message>
        <source>Time</source>
        <translation>时间</translation>
    </message>
    <message>
        <source>User</source>
        <translation>用户</translation>
    </message>
    <message>
        <source>Largest difference to the run</source>
        <translation>与在线结果的最大差值</translation>
    </message>
    <message>
        <source>Stages</source>
        <translation>阶段</translation>
    </message>
    <message>
        <source>Samples</source>
        <translation>采样点</translation>
    </message>
    <message>
        <source>Software</source>
        <translation>软件版本</translation>
    </message>
    <message>
        <source>, </source>
        <translation>、</translation>
    </message>
    <message>
        <source>no result of the run</source>
        <translation>无在线结果</translation>
    </message>
    <message>
        <source>identical bit for bit</source>
        <translation>逐位完全一致</translation>
    </message>
    <message>
        <source>no parameter in common</source>
        <translation>无共同参数</translation>
    </message>
    <message>
        <source>{0} σ, {1}</source>
        <translation>{0} σ，{1}</translation>
    </message>
    <message>
        <source>trial with {0}: {1}</source>
        <translation>试算（加入{0}）：{1}</translation>
    </message>
    <message>
        <source>States added: {0}</source>
        <translation>增加的状态：{0}</translation>
    </message>
    <message>
        <source>Configuration: {0}</source>
        <translation>配置：{0}</translation>
    </message>
</context>
<context>
    <name>RunComparison</name>
    <message>
        <source>Back to the list</source>
        <translation>返回列表</translation>
    </message>
    <message>
        <source>Parameters of the selected runs</source>
        <translation>所选标定的参数</translation>
    </message>
    <message>
        <source>{0} runs of {1}</source>
        <translation>{1} 的 {0} 次标定</translation>
    </message>
    <message>
        <source>, </source>
        <translation>、</translation>
    </message>
    <message>
        <source>{0} runs of {1} units</source>
        <translation>{1} 个产品的 {0} 次标定</translation>
    </message>
    <message>
        <source>Differences are those to the first run, in sigmas of the difference.</source>
        <translation>差值为与首次标定之差，以差值的标准差为单位。</translation>
    </message>
    <message>
        <source>Those beyond 3 σ are marked.</source>
        <translation>超过 3 σ 的已标出。</translation>
    </message>
    <message>
        <source>No run has limits, so no value is drawn.</source>
        <translation>这些标定都没有限差，因此未绘图。</translation>
    </message>
</context>
<context>
    <name>RunDetails</name>
    <message>
        <source>and {0} more</source>
        <translation>另有 {0} 项</translation>
    </message>
    <message>
        <source>Outside its limits:</source>
        <translation>超出限差：</translation>
    </message>
    <message>
        <source>The run was stopped by the operator.</source>
        <translation>操作员停止了这次标定。</translation>
    </message>
    <message>
        <source>The run did not reach its end.</source>
        <translation>这次标定没有做完。</translation>
    </message>
    <message>
        <source>Started</source>
        <translation>开始时间</translation>
    </message>
    <message>
        <source>Duration</source>
        <translation>用时</translation>
    </message>
    <message>
        <source>Product</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>Attempt</source>
        <translation>次数</translation>
    </message>
    <message>
        <source>Station</source>
        <translation>工位</translation>
    </message>
    <message>
        <source>Operator</source>
        <translation>操作员</translation>
    </message>
    <message>
        <source>Resumed from</source>
        <translation>接续自</translation>
    </message>
    <message>
        <source>Software</source>
        <translation>软件版本</translation>
    </message>
    <message>
        <source>Stages</source>
        <translation>阶段</translation>
    </message>
    <message>
        <source>Result</source>
        <translation>查看结果</translation>
    </message>
    <message>
        <source>Log</source>
        <translation>查看记录</translation>
    </message>
    <message>
        <source>Folder</source>
        <translation>文件夹</translation>
    </message>
    <message>
        <source>Resume</source>
        <translation>接着做</translation>
    </message>
    <message>
        <source>All units of the batch</source>
        <translation>本批全部产品</translation>
    </message>
    <message>
        <source>It can be resumed after its last completed stage, or closed.</source>
        <translation>可以从最后完成的阶段之后接着做，或就此结束。</translation>
    </message>
    <message>
        <source>It was closed and cannot be resumed.</source>
        <translation>已经结束，不能再接着做。</translation>
    </message>
    <message>
        <source>Cycle</source>
        <translation>节拍</translation>
    </message>
    <message>
        <source>Batch</source>
        <translation>批次</translation>
    </message>
    <message>
        <source>Slot</source>
        <translation>装夹位</translation>
    </message>
    <message>
        <source>Log at</source>
        <translation>数据记录位置</translation>
    </message>
    <message>
        <source>The log is only at the station {0}, which keeps no archive of logs: {1}</source>
        <translation>数据记录只在工位 {0}，该工位没有数据记录归档：{1}</translation>
    </message>
    <message>
        <source>{0}, of which {1} not in stages</source>
        <translation>{0}，其中标定阶段以外 {1}</translation>
    </message>
    <message>
        <source>Close as incomplete</source>
        <translation>按未完成结束</translation>
    </message>
    <message>
        <source>Do not resume</source>
        <translation>不再接着做</translation>
    </message>
    <message>
        <source>No parameter was solved in this run</source>
        <translation>这次标定没有解算出参数</translation>
    </message>
    <message>
        <source>Show every parameter of this run</source>
        <translation>显示这次标定的全部参数</translation>
    </message>
    <message>
        <source>The log is no longer there</source>
        <translation>数据记录已不在原处</translation>
    </message>
    <message>
        <source>Draw the log and solve it again</source>
        <translation>查看数据曲线并离线解算</translation>
    </message>
    <message>
        <source>A run is going on; wait for its end</source>
        <translation>正在标定，请等它结束</translation>
    </message>
    <message>
        <source>Resume after the last completed stage</source>
        <translation>从最后完成的阶段之后继续</translation>
    </message>
    <message>
        <source>It is being closed</source>
        <translation>正在结束</translation>
    </message>
    <message>
        <source>The run keeps its outcome and can then no longer be resumed</source>
        <translation>结果不变，以后不能再接着做</translation>
    </message>
</context>
<context>
    <name>RunTable</name>
    <message>
        <source>Outcome</source>
        <translation>结果</translation>
    </message>
    <message>
        <source>Serial number</source>
        <translation>序列号</translation>
    </message>
    <message>
        <source>Started</source>
        <translation>开始时间</translation>
    </message>
    <message>
        <source>Product</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>Attempt</source>
        <translation>次数</translation>
    </message>
    <message>
        <source>Operator</source>
        <translation>操作员</translation>
    </message>
    <message>
        <source>Duration</source>
        <translation>用时</translation>
    </message>
    <message>
        <source>Station</source>
        <translation>工位</translation>
    </message>
    <message>
        <source>Batch</source>
        <translation>批次</translation>
    </message>
    <message>
        <source>Slot</source>
        <translation>装夹位</translation>
    </message>
    <message>
        <source>Stages</source>
        <translation>阶段</translation>
    </message>
    <message>
        <source>, </source>
        <translation>、</translation>
    </message>
</context>
<context>
    <name>Trend</name>
    <message>
        <source>This unit&apos;s runs</source>
        <translation>该产品历次标定</translation>
    </message>
    <message>
        <source>Parameter</source>
        <translation>参数</translation>
    </message>
    <message>
        <source>The parameter over the unit&apos;s runs</source>
        <translation>该参数随历次标定的变化</translation>
    </message>
</context>
<context>
    <name>VersionsView</name>
    <message>
        <source>Back to the list</source>
        <translation>返回列表</translation>
    </message>
    <message>
        <source>The versions could not be read</source>
        <translation>无法读取版本</translation>
    </message>
    <message>
        <source>The versions cannot be compared</source>
        <translation>无法比较这些版本</translation>
    </message>
    <message>
        <source>Rows of the plot</source>
        <translation>图中各行</translation>
    </message>
    <message>
        <source>Compare</source>
        <translation>比较</translation>
    </message>
    <message>
        <source>Export…</source>
        <translation>导出…</translation>
    </message>
    <message>
        <source>Before</source>
        <translation>变更前</translation>
    </message>
    <message>
        <source>After</source>
        <translation>变更后</translation>
    </message>
    <message>
        <source>Changed verdicts</source>
        <translation>判定变化</translation>
    </message>
    <message>
        <source>Moves of the parameters, σ</source>
        <translation>参数变化量，σ</translation>
    </message>
    <message>
        <source>Median, σ</source>
        <translation>中位数，σ</translation>
    </message>
    <message>
        <source>95 %, σ</source>
        <translation>95 %，σ</translation>
    </message>
    <message>
        <source>Largest, σ</source>
        <translation>最大，σ</translation>
    </message>
    <message>
        <source>Unit with the largest</source>
        <translation>变化最大的产品</translation>
    </message>
    <message>
        <source>Results of the runs</source>
        <translation>标定时的结果</translation>
    </message>
    <message>
        <source>Export the comparison, or the later version as Parquet</source>
        <translation>导出比较结果，或将变更后的版本导出为 Parquet</translation>
    </message>
    <message>
        <source>There are no two versions to compare</source>
        <translation>没有可比较的两个版本</translation>
    </message>
    <message>
        <source>Choose two different versions</source>
        <translation>请选择两个不同的版本</translation>
    </message>
    <message>
        <source>Compare these versions on the logs that both have</source>
        <translation>在两个版本共有的数据记录上进行比较</translation>
    </message>
    <message>
        <source>Write the comparison, or the later version as Parquet</source>
        <translation>保存比较结果，或将变更后的版本存为 Parquet</translation>
    </message>
    <message>
        <source>By parameter</source>
        <translation>按参数</translation>
    </message>
    <message>
        <source>{0} logs in both versions</source>
        <translation>两个版本共有 {0} 份数据记录</translation>
    </message>
    <message>
        <source>{0} only before, {1} only after</source>
        <translation>仅变更前有 {0} 份，仅变更后有 {1} 份</translation>
    </message>
    <message>
        <source>PASS to FAIL: {0}, FAIL to PASS: {1}</source>
        <translation>合格变为不合格 {0} 份，不合格变为合格 {1} 份</translation>
    </message>
    <message>
        <source>Solutions of many logs are kept in a database that stations share. Name one on the page Station.</source>
        <translation>大量数据记录的解算结果保存在各工位共用的数据库中，请在“工位”页面填写该数据库。</translation>
    </message>
    <message>
        <source>This station shares no records</source>
        <translation>本工位未共享记录</translation>
    </message>
    <message>
        <source>Reading the versions</source>
        <translation>正在读取版本</translation>
    </message>
    <message>
        <source>Solve the logs again with another version of the program or another configuration, and compare the answers here: calstation fleet resolve archive --database URL --patch FILE.toml</source>
        <translation>用另一版本的程序或另一配置重新解算数据记录，然后在此比较结果：calstation fleet resolve archive --database URL --patch FILE.toml</translation>
    </message>
    <message>
        <source>There are no two versions to compare yet</source>
        <translation>还没有可比较的两个版本</translation>
    </message>
    <message>
        <source>Changed verdicts and how far every parameter moved, in sigmas, over the logs of all stations.</source>
        <translation>显示所有工位数据记录的判定变化，以及每个参数变化了多少 σ。</translation>
    </message>
    <message>
        <source>Choose two versions and press Compare</source>
        <translation>请选择两个版本，然后按“比较”</translation>
    </message>
    <message>
        <source>By product</source>
        <translation>按产品</translation>
    </message>
    <message>
        <source>By station</source>
        <translation>按工位</translation>
    </message>
    <message>
        <source>By month</source>
        <translation>按月份</translation>
    </message>
    <message>
        <source>Changed verdicts: {0}</source>
        <translation>判定变化：{0} 份</translation>
    </message>
    <message>
        <source>Changed verdicts: {0}, the first {1} listed</source>
        <translation>判定变化：{0} 份，列出前 {1} 份</translation>
    </message>
    <message>
        <source>No verdict changed</source>
        <translation>判定均未变化</translation>
    </message>
    <message>
        <source>Serial number</source>
        <translation>序列号</translation>
    </message>
    <message>
        <source>Product</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>Station</source>
        <translation>工位</translation>
    </message>
    <message>
        <source>Started</source>
        <translation>开始时间</translation>
    </message>
    <message>
        <source>Failed checks</source>
        <translation>未通过的检查</translation>
    </message>
    <message>
        <source>not judged</source>
        <translation>未判定</translation>
    </message>
    <message>
        <source>not solved</source>
        <translation>未解出</translation>
    </message>
</context>
</TS>
